"""Rewards of drones that must not come too late: a parameter of its own for being under way at the end.

As of patrollers (``games.patrol.arrival``), with s' where action a leads:

    late_i(s, a) = LATE_SCALE ( gamma 1[s'_i under way] - 1[s_i under way] + 1 / sum_t gamma^t )

of which the discounted sum over a flight that begins under way is gamma^{T+1} LATE_SCALE where drone i does not arrive,
and 0 where it does. RBFs of places cannot say at what time a drone is where it is.

Lateness is a count, of which no demonstration has any, and is learned by ratios. AdaGrad's steps would remember how
late everybody was in the beginning, and not reach the last percent: drones that hover instead of arriving, which finer
planners, having more ways to hover, do ten times as often.
"""

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_core.arithmetic import powers
from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.rewards import DroneRewardModel, LinearDroneReward, NeuralDroneReward
from mabirds_core.games.interface import Visitation

LATE_SCALE = 10.0
"""As of patrollers: drones are late seldom, and a larger feature learns faster."""


class _ArrivingReward(ABC):
    """r_theta(s, a) = r_u(s, a) + sum_i v_i late_i(s_i, a_i) with theta = (u, v)."""

    game: DroneGame

    @property
    @abstractmethod
    def places(self) -> DroneRewardModel:
        """r_u."""

    @cached_property
    def counts(self) -> Mask:
        """Lateness is: of no flight is it less than 0. Shape (size,)."""
        return np.arange(self.size) >= self.places.size

    @property
    def size(self) -> int:
        """That of u, and N_E."""
        return self.places.size + self.game.n_experts

    def initial(self, rng: np.random.Generator) -> Vector:
        """u as r_u has it, v zeros, shape (size,): every policy looks alike."""
        return np.concatenate([self.places.initial(rng), np.zeros(self.game.n_experts)])

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        """That of r_u by u, and each drone's lateness, shape (size,)."""
        return np.concatenate([self.places.gradient(self._split(theta)[0], visitation), self.lateness(visitation)])

    def lateness(self, visitation: Visitation) -> Vector:
        """The visitation's total of each drone's lateness, shape (N_E,)."""
        drones, controls = self.game.drones(visitation.states), self.game.controls(visitation.actions)
        late = (self._late(i, drones[:, i], controls[:, i]) for i in range(self.game.n_experts))
        return np.array([(visitation.weights * of).sum() for of in late])

    def unary(self, theta: Vector, drone: int, states: Array, actions: Array) -> Array:
        """Rewards of one drone's place and of its lateness."""
        places, late = self._split(theta)
        of_place = self.places.unary(places, drone, states, actions)
        return np.asarray(of_place + late[drone] * self._late(drone, states, actions))

    def pairwise(self, theta: Vector, pair: int, distances: Array) -> Array:
        """What r_u has for distances."""
        return self.places.pairwise(self._split(theta)[0], pair, distances)

    def arriving(self, theta: Vector, drone: int) -> float:
        """What a step earns besides where it ends in the goal region.

        Parameters
        ----------
        theta : Vector
            Shape (size,).
        drone : int
            Index i.

        Returns
        -------
        float
            -gamma LATE_SCALE v_i.
        """
        return float(-self.game.discount * LATE_SCALE * self._split(theta)[1][drone])

    def _split(self, theta: Vector) -> list[Vector]:
        """u and v."""
        return np.split(theta, [self.places.size])

    def _late(self, drone: int, states: Array, actions: Array) -> Array:
        """late_i of states (..., D) and actions that fit them."""
        dynamics = self.game.dynamics.of_drone(drone)
        shape = np.broadcast_shapes(states.shape[:-1], actions.shape[:-1])
        here = np.broadcast_to(states, (*shape, states.shape[-1]))[..., None, :]
        after = dynamics.step(here, np.broadcast_to(actions, (*shape, 2))[..., None, :])
        under_way, still = (~dynamics.arrived(at[..., :2])[..., 0] for at in (here, after))
        return np.asarray(LATE_SCALE * (self.game.discount * still - under_way + 1 / self._steps))

    @cached_property
    def _steps(self) -> float:
        """sum_t gamma^t, t = 0..T."""
        return float(powers(self.game.discount, self.game.horizon + 1).sum())


@dataclass(frozen=True)
class ArrivingDroneReward(_ArrivingReward):
    """r_theta(s, a) = u^T f(s, a) + sum_i v_i late_i(s_i, a_i) with theta = (u, v).

    Attributes
    ----------
    game : DroneGame
        With N_E drones and K_f reward features.
    """

    game: DroneGame

    @cached_property
    def places(self) -> LinearDroneReward:
        """u^T f."""
        return LinearDroneReward(self.game)

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of theta's entries: places, then lateness, drone by drone."""
        return (*self.places.features.names, *(f"drone_{drone + 1} late" for drone in range(self.game.n_experts)))

    @property
    def total_size(self) -> int:
        """As ``size``: it is a sum of features."""
        return self.size

    def total(self, visitation: Visitation) -> Vector:
        """The visitation's total of f, and of each drone's lateness, shape (size,)."""
        return np.concatenate([self.places.total(visitation), self.lateness(visitation)])

    def gradient_of_total(self, theta: Vector, total: Vector) -> Vector:  # noqa: ARG002 - linear in theta
        """The total itself."""
        return total


@dataclass(frozen=True)
class ArrivingNeuralDroneReward(_ArrivingReward):
    """A network of each drone's place, and sum_i v_i late_i(s_i, a_i) beside it: no place is late by itself.

    Attributes
    ----------
    game : DroneGame
        With N_E drones.
    hidden : int
        Units of a network.
    bound : float
        Of what networks say together.
    """

    game: DroneGame
    hidden: int
    bound: float

    @cached_property
    def places(self) -> NeuralDroneReward:
        """The networks."""
        return NeuralDroneReward(self.game, self.hidden, self.bound)
