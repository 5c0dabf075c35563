"""What is to be beaten on flights that nobody learned from: forecasters that learn nothing, or one number.

All are told on the lattice on which policies are: at step t a drone of which the flight shown is at q_t goes to the
node that is nearest to q_{t+1} (``demonstrated.snapped``), and a forecaster says how likely it is against the base
measure mu of moves,

    pi(a) proportional to mu(a) exp( -|s' - s*|^2 / 2 sigma^2 )

with sigma that makes the flights of the training likeliest. What differs is where the drone is expected next:

    straight to the goal   s* one step on the straight way to its goal region
    constant velocity      s* = 2 q_t - q_{t-1}, the place shown and the way of the last step once more
    counting               s* = the mean of what drones did in the training near the same place

For whole flights, a drone of constant velocity goes on as in its first step, which it is told, plus a deviation drawn
with the variance that it has in the training.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.demonstrated import NOISES, Snapped, log_ratios, snapped
from mabirds_core.games.drones.drone_nodes import DroneNodes
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePolicy
from mabirds_core.games.drones.lone_drone import log_shares, log_sum_exp
from mabirds_core.games.drones.rollouts import DronePolicy
from mabirds_core.games.interface import Trajectories

NEAR = 2.0
"""Steps' ways within which training counts as near."""

Aims = Callable[[Snapped, int, Trajectories], Array]
"""Where a drone is expected next: from a step of demonstrations, the drone's index and the demonstrations; (m, 2)."""


@dataclass(frozen=True)
class PolicyForecast:
    """A policy on a lattice, learned or not."""

    policy: LatticePolicy

    def log_ratios(self, demonstrations: Trajectories) -> Vector:
        """Nats by which demonstrations are likelier than under the uniform policy, shape (m,)."""
        return log_ratios(self.policy, demonstrations)

    def rollouts(self, demonstrations: Trajectories, count: int, rng: np.random.Generator) -> Trajectories:
        """``count`` flights from each demonstration's start."""
        return from_starts(self.policy.game, self.policy, demonstrations, count, rng)


@dataclass(frozen=True)
class AimedForecast:
    """Flight towards expected places with noise."""

    game: DroneGame
    drones: list[DroneNodes]
    aims: Aims
    training: Trajectories

    @cached_property
    def noise(self) -> float:
        """sigma as a multiple of a step's way, of the training."""
        totals = self._totals(self.training, NOISES)
        return float(NOISES[totals.mean(axis=1).argmax()])

    def log_ratios(self, demonstrations: Trajectories) -> Vector:
        """Nats by which demonstrations are likelier than under the uniform policy, shape (m,)."""
        return np.asarray(self._totals(demonstrations, np.array([self.noise]))[0])

    def rollouts(self, demonstrations: Trajectories, count: int, rng: np.random.Generator) -> Trajectories:
        """``count`` flights from each demonstration's start."""
        return from_starts(self.game, self, demonstrations, count, rng)

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """An action of each drone for M joint states, shape (M, 2 N_E)."""
        places, ways = self.game.positions(states), []
        still = Trajectories(states[:, None], np.zeros((len(states), 1, self.game.action_size)))
        for i, drone in enumerate(self.drones):
            at = Snapped(step, states, [], [], np.ones(len(states), np.bool_))
            nodes, scores, _ = self._scores(drone, places[:, i], self.aims(at, i, still), np.array([self.noise]))
            drawn = (scores[0] + rng.gumbel(size=scores[0].shape)).argmax(axis=1)
            ways.append(drone.velocities(places[:, i], np.take_along_axis(nodes, drawn[:, None], axis=1))[:, 0])
        return np.concatenate(ways, axis=1)

    def _totals(self, demonstrations: Trajectories, noises: Vector) -> Array:
        """log pi/mu for each noise and demonstration, shape (n, m)."""
        totals = np.zeros((len(noises), len(demonstrations.states)))
        for at in snapped(self.game, self.drones, demonstrations):
            for i, drone in enumerate(self.drones):
                places = self.game.positions(at.states)[:, i]
                aims = self.aims(at, i, demonstrations)
                totals += at.under_way * self._told(drone, places, aims, at.nodes[i], noises)
        return totals

    def _told(self, drone: DroneNodes, places: Array, aims: Array, chosen: Indices, noises: Vector) -> Array:
        """log pi/mu of chosen nodes (m,) for each noise, shape (n, m)."""
        nodes, scores, shares = self._scores(drone, places, aims, noises)
        at = (nodes == chosen[:, None]).argmax(axis=1)
        rows = np.arange(len(places))
        return np.asarray(scores[:, rows, at] - shares[rows, at] - log_sum_exp(scores))

    def _scores(self, drone: DroneNodes, places: Array, aims: Array, noises: Vector) -> tuple[Indices, Array, Array]:
        """Nodes of moves (m, A), log mu - |s' - s*|^2 / 2 sigma^2 for each noise (n, m, A), log mu (m, A)."""
        moves = drone.moves_from(places)
        shares = log_shares(moves.shares)
        away = ((drone.places[moves.nodes] - aims[:, None]) ** 2).sum(axis=-1)
        return moves.nodes, shares - away / (2 * (noises[:, None, None] * self.game.dynamics.reach) ** 2), shares


@dataclass(frozen=True)
class VelocityForecast(AimedForecast):
    """Constant velocity."""

    @cached_property
    def deviation(self) -> float:
        """Of the mean velocity of a training flight from that of its first step, by axis [m/s]."""
        game, away = self.game, list[Array]()
        for states in self.training.states:
            places = game.positions(states)
            for i in range(game.n_experts):
                last = max(1, int((~game.arrived(states)[:, i]).sum()))
                mean = (places[min(last, game.horizon), i] - places[0, i]) / min(last, game.horizon)
                away.append((mean - (places[1, i] - places[0, i])) / game.dynamics.time_step)
        return float(np.sqrt(np.mean(np.square(away))))

    def rollouts(self, demonstrations: Trajectories, count: int, rng: np.random.Generator) -> Trajectories:
        """``count`` flights from each demonstration's start."""
        first = np.repeat(demonstrations.actions[:, 0], count, axis=0)
        drawn = first + self.deviation * rng.standard_normal(first.shape)
        return from_starts(self.game, _Constant(drawn), demonstrations, count, rng)


@dataclass(frozen=True)
class _Constant:
    """The same actions at every step."""

    actions: Array

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:  # noqa: ARG002 - whatever they are
        return self.actions


def from_starts(
    game: DroneGame, policy: DronePolicy, demonstrations: Trajectories, count: int, rng: np.random.Generator
) -> Trajectories:
    """Flights from where demonstrations began.

    Parameters
    ----------
    game : DroneGame
        Whose dynamics lead on.
    policy : DronePolicy
        Is followed.
    demonstrations : Trajectories
        m of them.
    count : int
        k: flights from each start.
    rng : np.random.Generator
        Of the actions.

    Returns
    -------
    Trajectories
        m k of them, those of the first start first.
    """
    states = np.repeat(demonstrations.states[:, 0], count, axis=0)
    flown, actions = list[Array](), list[Array]()
    for step in range(game.horizon + 1):
        flown.append(states)
        actions.append(policy.act(step, states, rng))
        states = game.step(states, actions[-1])
    return Trajectories(np.stack(flown, axis=1), np.stack(actions, axis=1))


def forecasts(policy: LatticePolicy, training: Trajectories) -> Mapping[str, AimedForecast]:
    """What learned policies are compared with beside other policies.

    Parameters
    ----------
    policy : LatticePolicy
        Whose lattice flights are followed on.
    training : Trajectories
        From which noises are taken.

    Returns
    -------
    Mapping[str, AimedForecast]
        By name.
    """
    game, drones = policy.game, [of.nodes for of in policy.drones]
    return {
        "counting": AimedForecast(game, drones, _Counted(game, training), training),
        "constant velocity": VelocityForecast(game, drones, _same_way_of(game), training),
        "straight to the goal": AimedForecast(game, drones, _straight_of(game), training),
    }


def _straight_of(game: DroneGame) -> Aims:
    def aims(at: Snapped, drone: int, _: Trajectories) -> Array:
        places = game.positions(at.states)[:, drone]
        ways = game.settings.drones[drone].goal_region.nearest(places) - places
        lengths = np.sqrt((ways**2).sum(axis=1, keepdims=True))
        reach = game.dynamics.reach
        return np.asarray(places + ways * np.minimum(1.0, reach / np.maximum(lengths, reach / 2)))

    return aims


def _same_way_of(game: DroneGame) -> Aims:
    straight = _straight_of(game)

    def aims(at: Snapped, drone: int, shown: Trajectories) -> Array:
        if at.step == 0:  # no way was seen yet
            return straight(at, drone, shown)
        before, now = (game.positions(shown.states[:, step])[:, drone] for step in (at.step - 1, at.step))
        return np.asarray(2 * now - before)

    return aims


class _Counted:
    """Means of what drones did in the training near a place, each drone by its own."""

    def __init__(self, game: DroneGame, training: Trajectories) -> None:
        self._game, under_way = game, ~game.arrived(training.states)
        places, ways = game.positions(training.states), game.controls(training.actions) * game.dynamics.time_step
        self._seen = [(places[of, i], ways[of, i]) for i, of in enumerate(np.moveaxis(under_way, -1, 0))]

    def __call__(self, at: Snapped, drone: int, _: Trajectories) -> Array:
        places, (seen, ways) = self._game.positions(at.states)[:, drone], self._seen[drone]
        away = ((places[:, None] - seen) ** 2).sum(axis=-1) / (NEAR * self._game.dynamics.reach / 2) ** 2
        weights = np.exp(-(away - away.min(axis=1, keepdims=True)) / 2)
        return np.asarray(places + (weights @ ways) / weights.sum(axis=1, keepdims=True))
