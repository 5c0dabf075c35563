"""The recursion of the lattice planner once more, slowly and in the open."""

import math
from itertools import product

import numpy as np
from arenas import Pair, SlowArena

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.rewards import LinearDroneReward, NeuralDroneReward, TrueDroneReward

Model = LinearDroneReward | NeuralDroneReward | TrueDroneReward


def log_sum_exp(terms: Array) -> Vector:
    """Along the last axis."""
    most = terms.max(axis=-1, keepdims=True)
    return np.asarray(most[..., 0] + np.log(np.exp(terms - most).sum(axis=-1)))


def slow_action_set(speed: float) -> tuple[list[Pair], list[float]]:
    """Rest, 8 directions at half speed, 16 at full speed; the shares of the rings around them."""
    rings = [(0.0, 1, 0.25**2), (0.5, 8, 0.75**2 - 0.25**2), (1.0, 16, 1 - 0.75**2)]
    turns = [(radius * speed, 2 * math.pi * k / count) for radius, count, _ in rings for k in range(count)]
    shares = [area / count for _, count, area in rings for _ in range(count)]
    return [(length * math.cos(angle), length * math.sin(angle)) for length, angle in turns], shares


class SlowLattice:
    """Values without factors: all joint actions to all joint nodes, in logs."""

    def __init__(self, model: Model, at: Parameters, spacing: float = 0.8, temperature: float = 1.0) -> None:
        self.model, self.game, self.at, self.temperature = model, model.game, at, temperature
        self.slow, (self.velocities, shares) = (
            SlowArena(self.game.settings),
            slow_action_set(self.game.settings.max_speed),
        )
        self.nodes, n = self.slow.nodes(spacing), self.game.n_experts
        self.actions = np.array([np.concatenate(own) for own in product(self.velocities, repeat=n)])
        self.log_shares = np.array([sum(map(math.log, own)) for own in product(shares, repeat=n)])
        self.values = np.zeros((self.game.horizon + 2, len(self.nodes) ** n))
        states = [np.concatenate(own) for own in product(self.nodes, repeat=n)]
        backups = [(self.scores(state), self.ahead(state)) for state in states]
        for step in range(self.game.horizon, -1, -1):
            later = self.game.discount * self.values[step + 1]
            with np.errstate(divide="ignore"):
                self.values[step] = [log_sum_exp(own + log_sum_exp(np.log(to) + later)) for own, to in backups]

    def scores(self, state: Vector) -> Vector:
        """log mu(a) + r(s, a) / tau of every joint action."""
        here = np.repeat(state[None], len(self.actions), axis=0)
        reward = total_reward(self.game.space, self.model, self.at.theta, here, self.actions)
        cost = total_reward(self.game.space, self.game.cost_features, self.at.omega, here, self.actions)
        return self.log_shares + (reward + cost) / self.temperature

    def ahead(self, state: Vector) -> Array:
        """Weights of all joint nodes at what follows each joint action."""
        rows = np.ones((1, 1))
        for drone, (x, y) in enumerate(state.reshape(-1, 2).tolist()):
            places = [self.slow.after(drone, (x, y), velocity) for velocity in self.velocities]
            rows = np.kron(rows, [[self.hat(place, node) for node in self.nodes] for place in places])
        return rows

    def hat(self, place: Pair, node: Pair) -> float:
        """Bilinear weight of a node at a place: 1 there, 0 from its neighbours on."""
        steps = [max(axis) / (len(set(axis)) - 1) for axis in zip(*self.nodes, strict=True)]
        away = [abs(x - c) / step for x, c, step in zip(place, node, steps, strict=True)]
        return math.prod(max(0.0, 1 - d) for d in away)

    def log_probabilities(self, step: int, state: Vector) -> Vector:
        """log pi_t(a | s) of every joint action, by values interpolated between the nodes."""
        q = self.scores(state) + self.ahead(state) @ (self.game.discount * self.values[step + 1])
        return np.asarray(q - log_sum_exp(q))
