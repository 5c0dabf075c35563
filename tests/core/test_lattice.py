"""Soft value iteration on a lattice against sums over all joint moves that are written out, and what theory says."""

import math
from collections.abc import Callable
from itertools import product

import numpy as np
import pytest
from rooms import Pair, SlowRoom, random_flights, room

from mabirds_core.arrays import Array, Vector
from mabirds_core.drone_rewards import DroneRewardModel, LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.drone_features import total_reward
from mabirds_core.games.drones import DroneGame
from mabirds_core.games.interface import discounted_visitation
from mabirds_core.gradient import GradientEstimator
from mabirds_core.parameters import Parameters
from mabirds_core.policies.drone_rollouts import SampledDroneExpectation, drone_rollouts
from mabirds_core.policies.lattice import Lattice, LatticeFinder, LatticePolicy, moves

pytestmark = pytest.mark.filterwarnings("error")

every_size = pytest.mark.parametrize("drones", [1, 2])


def some_parameters(model: DroneRewardModel, scale: float = 1.0, seed: int = 0) -> Parameters:
    rng = np.random.default_rng(seed)
    sizes = model.size, len(model.game.cost_features.names)
    return Parameters(*(scale * rng.normal(size=size) for size in sizes))


def found(model: DroneRewardModel, at: Parameters, spacing: float = 0.8, temperature: float = 1.0) -> LatticePolicy:
    return LatticeFinder(model.game, model, spacing, temperature).find(*at)


def log_sum_exp(terms: Array) -> Vector:
    """Along the last axis."""
    most = terms.max(axis=-1, keepdims=True)
    return np.asarray(most[..., 0] + np.log(np.exp(terms - most).sum(axis=-1)))


def slow_moves(speed: float) -> tuple[list[Pair], list[float]]:
    """Rest, 8 directions at half speed, 16 at full speed; the shares of the rings around them."""
    rings = [(0.0, 1, 0.25**2), (0.5, 8, 0.75**2 - 0.25**2), (1.0, 16, 1 - 0.75**2)]
    turns = [(radius * speed, 2 * math.pi * k / count) for radius, count, _ in rings for k in range(count)]
    shares = [area / count for _, count, area in rings for _ in range(count)]
    return [(length * math.cos(angle), length * math.sin(angle)) for length, angle in turns], shares


class SlowLattice:
    """The recursion of the lattice finder without factors: all joint moves to all joint nodes, in logs."""

    def __init__(self, game: DroneGame, at: Parameters, spacing: float = 0.8, temperature: float = 1.0) -> None:
        self.game, self.at, self.temperature = game, at, temperature
        self.slow, velocities_and_shares = SlowRoom(game.settings), slow_moves(game.settings.max_speed)
        self.nodes, n = self.slow.nodes(spacing), game.n_experts
        self.velocities = velocities_and_shares[0]
        self.actions = np.array([np.concatenate(own) for own in product(self.velocities, repeat=n)])
        self.log_shares = np.array([sum(map(math.log, own)) for own in product(velocities_and_shares[1], repeat=n)])
        self.values = np.zeros((game.horizon + 2, len(self.nodes) ** n))
        states = [np.concatenate(own) for own in product(self.nodes, repeat=n)]
        backups = [(self.scores(state), self.ahead(state)) for state in states]
        for step in range(game.horizon, -1, -1):
            later = game.discount * self.values[step + 1]
            with np.errstate(divide="ignore"):
                self.values[step] = [log_sum_exp(own + log_sum_exp(np.log(to) + later)) for own, to in backups]

    def scores(self, state: Vector) -> Vector:
        """log mu(a) + r(s, a) / tau of every joint move."""
        here = np.repeat(state[None], len(self.actions), axis=0)
        reward = total_reward(self.game, LinearDroneReward(self.game), self.at.theta, here, self.actions)
        cost = total_reward(self.game, self.game.cost_features, self.at.omega, here, self.actions)
        return self.log_shares + (reward + cost) / self.temperature

    def ahead(self, state: Vector) -> Array:
        """Weights of all joint nodes at what follows each joint move."""
        rows = np.ones((1, 1))
        for drone, place in enumerate(state.reshape(-1, 2).tolist()):
            there = [self.slow.after(drone, tuple(place), velocity) for velocity in self.velocities]
            rows = np.kron(rows, [[self.hat(there, node) for node in self.nodes] for there in there])
        return rows

    def hat(self, place: Pair, node: Pair) -> float:
        """Bilinear weight of a node at a place: 1 there, 0 from its neighbours on."""
        steps = [max(axis) / (len(set(axis)) - 1) for axis in zip(*self.nodes, strict=True)]
        away = [abs(x - c) / step for x, c, step in zip(place, node, steps, strict=True)]
        return math.prod(max(0.0, 1 - d) for d in away)

    def log_probabilities(self, step: int, state: Vector) -> Vector:
        """log pi_t(a | s) of every joint move, by values interpolated between the nodes."""
        q = self.scores(state) + self.ahead(state) @ (self.game.discount * self.values[step + 1])
        return np.asarray(q - log_sum_exp(q))


def tiny(drones: int) -> DroneGame:
    """Three steps; the lattice of 0.8 m has 3 times 3 nodes, and moves and doors reach some of them."""
    return room(drones, {"horizon": 2, "max_speed": 2.4, "drones.0.door.radius": 0.4})


@pytest.mark.parametrize(
    ("drones", "scale", "temperature"), [(1, 1.0, 1.0), (1, 3.0, 0.2), (2, 1.0, 1.0), (2, 0.3, 0.1)]
)
def test_values_are_those_of_all_joint_moves_summed_up(drones: int, scale: float, temperature: float) -> None:
    game = tiny(drones)
    at = some_parameters(game, scale)
    slow, policy = SlowLattice(game, at, 0.8, temperature), found(game, at, 0.8, temperature)
    np.testing.assert_allclose(policy.values.reshape(slow.values.shape), slow.values, rtol=0, atol=1e-9)
    assert np.ptp(slow.values[0]) > 1


def alone_only(game: DroneGame, scale: float) -> Parameters:
    """Large rewards and costs of places and efforts, small ones of distances."""
    at = some_parameters(game, scale)
    distances = slice(game.n_experts * len(game.cost_features.lattice.nodes), -game.n_experts)
    at.omega[distances] *= 100 / scale
    return at


@every_size
def test_values_of_thousands_of_nats_neither_overflow_nor_vanish(drones: int) -> None:
    game = tiny(drones)
    at = alone_only(game, scale=5000.0)
    slow, policy = SlowLattice(game, at), found(game, at)
    np.testing.assert_allclose(policy.values.reshape(slow.values.shape), slow.values, rtol=1e-12, atol=1e-8)
    assert np.ptp(slow.values[0]) > 5000


def test_distances_that_cost_thousands_of_nats_leave_what_can_be_reached_exact() -> None:
    """Where the drones cost each other more than LEAST allows, values are too large, but still hopeless."""
    game = tiny(2)
    at = some_parameters(game)
    at.omega[-4:-2] = -3000.0
    slow, policy = SlowLattice(game, at), found(game, at)
    values = policy.values.reshape(slow.values.shape)
    assert np.isfinite(values).all()
    free = SlowLattice(game, Parameters(at.theta, np.where(at.omega < -1000, 0.0, at.omega)))
    hopeless = slow.values < free.values - 600
    assert 0.05 < hopeless[:-1].mean() < 0.95
    np.testing.assert_allclose(values[~hopeless], slow.values[~hopeless], rtol=1e-12, atol=1e-8)
    assert (values >= slow.values - 1e-6).all()
    assert (values[hopeless] < free.values[hopeless] - 500).all()
