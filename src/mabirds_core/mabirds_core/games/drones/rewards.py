"""Reward models r_theta of the drone game: linear, by a network a drone, and the true one for who is given it."""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.features import DroneReward, DroneRewardFeatures
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.interface import Visitation
from mabirds_core.rewards.models import FixedModel, LinearModel, RewardModel


class DroneRewardModel(RewardModel, DroneReward, Protocol):
    """A reward model that says what it is made of, drone by drone and pair by pair."""

    def unary(self, theta: Vector, drone: int, states: Array, actions: Array) -> Array:
        """Terms of one drone.

        Parameters
        ----------
        theta : Vector
            Reward parameters, shape (size,).
        drone : int
            Index i.
        states : Array
            Of the drone, shape (..., D).
        actions : Array
            Of the drone, shape (..., 2); of a shape that fits.

        Returns
        -------
        Array
            Shape (...).
        """
        ...

    def pairwise(self, theta: Vector, pair: int, distances: Array) -> Array:
        """Terms of two drones.

        Parameters
        ----------
        theta : Vector
            Reward parameters, shape (size,).
        pair : int
            Index into ``DroneGame.pairs``.
        distances : Array
            Of any shape [m].

        Returns
        -------
        Array
            Shape of ``distances``.
        """
        ...


@dataclass(frozen=True)
class LinearDroneReward(LinearModel):
    """r_theta(s, a) = theta^T f(s, a)."""

    game: DroneGame

    @property
    def features(self) -> DroneRewardFeatures:
        """f of the game."""
        return self.game.reward_features

    def unary(self, theta: Vector, drone: int, states: Array, actions: Array) -> Array:
        """theta^T f of one drone."""
        return self.game.reward_features.unary(theta, drone, states, actions)

    def pairwise(self, theta: Vector, pair: int, distances: Array) -> Array:
        """No cost of distances."""
        return self.game.reward_features.pairwise(theta, pair, distances)


@dataclass(frozen=True)
class NeuralDroneReward:
    """r_theta(s) = sum_i w_i, a network with two inputs and H hidden units for each drone's place:

        w_i = C / N_E  tanh( sum_h tanh(v_ih) tanh(U_ih x_i + b_ih) )

    x_i in [-1, 1]^2 is the place in the arena, so |r_theta| <= C. Gradient and Hessian are bounded for all theta
    (Assumption 1), as those of ``rewards.NeuralReward`` are. The gradient is torch.func's, in float64.
    """

    game: DroneGame
    hidden: int
    bound: float
    """C."""

    @property
    def size(self) -> int:
        """4 H N_E: two inputs, a bias and an output a unit."""
        return 4 * self.hidden * self.game.n_experts

    def initial(self, rng: np.random.Generator) -> Vector:
        """Standard normal inputs; outputs of zero, so that every policy looks alike at first."""
        drawn = rng.normal(size=(self.game.n_experts, 4, self.hidden))
        drawn[:, 3] = 0.0
        return drawn.ravel()

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        """grad_theta sum_k weights[k] r_theta(states[k]), shape (size,)."""
        import torch

        places = self._scaled(self.game.positions(visitation.states))
        weights, at = torch.tensor(visitation.weights), torch.tensor(theta)
        return np.asarray(torch.func.grad(lambda t: weights @ self._rewards(t, places).sum(dim=1))(at))

    def unary(self, theta: Vector, drone: int, states: Array, actions: Array) -> Array:  # noqa: ARG002 - of places
        """w_i of one drone."""
        import torch

        places = self._scaled(states[..., None, :2])
        parameters = torch.tensor(theta.reshape(self.game.n_experts, -1)[drone])
        return np.asarray(self._rewards(parameters, places)[..., 0])

    def pairwise(self, theta: Vector, pair: int, distances: Array) -> Array:  # noqa: ARG002 - each drone has its own
        """No cost of distances."""
        return np.zeros(distances.shape)

    def _scaled(self, places: Array) -> Any:
        """Places (..., n, 2) from -1 to 1 along each axis of the arena, as a tensor."""
        import torch

        return torch.from_numpy(2 * places / self.game.arena - 1)

    def _rewards(self, theta: Any, places: Any) -> Any:
        """w_i at scaled places (..., n, 2) of the n drones whose parameters ``theta`` holds, shape (..., n)."""
        count = places.shape[-2]
        u_x, u_y, bias, outputs = theta.reshape(count, 4, self.hidden).unbind(1)
        units = (places[..., :1] * u_x + places[..., 1:] * u_y + bias).tanh()
        return self.bound / self.game.n_experts * (units * outputs.tanh()).sum(-1).tanh()


@dataclass(frozen=True)
class TrueDroneReward(FixedModel):
    """What the experts are after: minus ``step_cost`` per step for each drone under way."""

    game: DroneGame

    def unary(self, theta: Vector, drone: int, states: Array, actions: Array) -> Array:  # noqa: ARG002
        """-step_cost where the drone is not in its goal region."""
        goal = self.game.settings.drones[drone].goal_region
        there = goal.away(states[..., :2]) <= goal.radius**2
        return np.where(there, 0.0, -self.game.settings.step_cost)

    def pairwise(self, theta: Vector, pair: int, distances: Array) -> Array:  # noqa: ARG002 - none
        """No cost of distances."""
        return np.zeros(distances.shape)
