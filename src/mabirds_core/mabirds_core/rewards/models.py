"""Reward models r_theta: how theta becomes a reward, and its gradient (paper, section 3 and Assumption 1)."""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import FeatureMap, RewardFeatureMap, TabularFeatureMap, TabularGame, Visitation
from mabirds_core.networks import BoundedNetwork


class RewardModel(Protocol):
    """A differentiable family of rewards."""

    @property
    def size(self) -> int:
        """Length of theta."""
        ...

    def initial(self, rng: np.random.Generator) -> Vector:
        """theta(1), shape (size,)."""
        ...

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        """grad J: sum_k weights[k] grad_theta r_theta(states[k], actions[k]).

        Parameters
        ----------
        theta : Vector
            Shape (size,).
        visitation : Visitation
            Weighted state-action pairs.

        Returns
        -------
        Vector
            Shape (size,).
        """
        ...


class SummableReward(RewardModel, Protocol):
    """A reward model whose gradient hangs on totals of features alone, so that a mean of demonstrations suffices."""

    @property
    def total_size(self) -> int:
        """K_f: length of the totals."""
        ...

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] f(states[k], actions[k]), shape (K_f,)."""
        ...

    def gradient_of_total(self, theta: Vector, total: Vector) -> Vector:
        """grad J for a total of the features.

        Parameters
        ----------
        theta : Vector
            Shape (size,).
        total : Vector
            As of ``total``, shape (K_f,).

        Returns
        -------
        Vector
            Shape (size,).
        """
        ...


class TabularRewardModel(RewardModel, Protocol):
    """Rewards of a tabular game."""

    def table(self, theta: Vector) -> Array:
        """r_theta(s, a) for every pair, shape (S, A)."""
        ...


class OfFeatures(Protocol):
    """What weighs features."""

    @property
    def features(self) -> FeatureMap:
        """f, shape (K,) at each state-action pair."""
        ...


class LinearModel:
    """theta^T f, for whatever the features ``features`` of its subclass are. theta(1) = 0."""

    @property
    def size(self: OfFeatures) -> int:
        """Number of reward features."""
        return len(self.features.names)

    def initial(self: OfFeatures, rng: np.random.Generator) -> Vector:  # noqa: ARG002 - other models draw from it
        """Zeros, shape (size,): every policy looks alike."""
        return np.zeros(len(self.features.names))

    @property
    def counts(self: OfFeatures) -> bool:
        """Are its gradients counts, which are never negative?"""
        return bool(getattr(self.features, "nonnegative", False))

    @property
    def total_size(self: OfFeatures) -> int:
        """Number of reward features."""
        return len(self.features.names)

    def total(self: OfFeatures, visitation: Visitation) -> Vector:
        """The visitation's total of the features, shape (size,)."""
        return self.features.total(visitation)

    def gradient(self: OfFeatures, theta: Vector, visitation: Visitation) -> Vector:  # noqa: ARG002 - linear in theta
        """The visitation's total of the features, shape (size,)."""
        return self.features.total(visitation)

    def gradient_of_total(self: OfFeatures, theta: Vector, total: Vector) -> Vector:  # noqa: ARG002 - linear in theta
        """The total itself, shape (size,)."""
        return total


class FixedModel:
    """A reward with nothing to learn: theta is empty."""

    counts = True
    total_size = 0

    @property
    def size(self) -> int:
        """Length of theta: 0."""
        return 0

    def initial(self, rng: np.random.Generator) -> Vector:  # noqa: ARG002 - nothing to draw
        """No numbers, shape (0,)."""
        return np.zeros(0)

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:  # noqa: ARG002 - no parameters
        """No numbers, shape (0,)."""
        return np.zeros(0)

    def total(self, visitation: Visitation) -> Vector:  # noqa: ARG002 - no parameters
        """No numbers, shape (0,)."""
        return np.zeros(0)

    def gradient_of_total(self, theta: Vector, total: Vector) -> Vector:  # noqa: ARG002 - no parameters
        """No numbers, shape (0,)."""
        return total


@dataclass(frozen=True)
class LinearReward(LinearModel):
    """r_theta(s, a) = theta^T f(s, a) of a tabular game; its gradient does not depend on theta."""

    features: TabularFeatureMap

    def weights(self, theta: Vector) -> Vector:
        """theta itself, shape (K,)."""
        return theta

    def table(self, theta: Vector) -> Array:
        """theta^T f(s, a), shape (S, A)."""
        return self.features.table(theta)


@dataclass(frozen=True)
class NeuralReward:
    """r_theta(s, a) = sum_k w_k(theta) f_k(s, a), where a small network makes the weights of the linear features:

        w_k = C / N_E  tanh( sum_h tanh(v_h) tanh(U_h x_k + b_h) )

    x_k in [-1, 1]^D describes feature k (``FeatureMap.descriptors``), and every state-action pair has one active
    feature an expert, so |r_theta| <= C. The gradient and the Hessian of r_theta are bounded for all theta
    (``networks``): |dw/dv_h| <= C / N_E, |dw/db_h| <= C / N_E, |dw/dU_hd| <= C / N_E.
    """

    features: RewardFeatureMap
    hidden: int
    bound: float
    """C."""
    n_experts: int
    counts = False

    @cached_property
    def _network(self) -> BoundedNetwork:
        return BoundedNetwork(self.features.descriptors, self.hidden)

    @property
    def size(self) -> int:
        """H (D + 2)."""
        return self._network.size

    def initial(self, rng: np.random.Generator) -> Vector:
        """Standard normal inputs; outputs of zero, so that every policy looks alike at first."""
        return self._network.initial(rng)

    def weights(self, theta: Vector) -> Vector:
        """w_k(theta), shape (K,)."""
        return self.bound / self.n_experts * self._network.values(theta)

    def table(self, theta: Vector) -> Array:
        """r_theta(s, a), shape (S, A)."""
        return self.features.table(self.weights(theta))

    @property
    def total_size(self) -> int:
        """Number of the features that are weighed."""
        return len(self._network.points)

    def total(self, visitation: Visitation) -> Vector:
        """The visitation's total of the features, shape (K,)."""
        return self.features.total(visitation)

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        """Backwards through the network from the visitation's total of the features, shape (size,)."""
        return self.gradient_of_total(theta, self.total(visitation))

    def gradient_of_total(self, theta: Vector, total: Vector) -> Vector:
        """Backwards through the network from a total of the features, shape (size,)."""
        return self._network.gradient(theta, self.bound / self.n_experts * total)


@dataclass(frozen=True)
class TrueReward(FixedModel):
    """The experts' own reward of a tabular game, for methods that are given it."""

    game: TabularGame

    def table(self, theta: Vector) -> Array:  # noqa: ARG002 - no parameters
        """The true reward, shape (S, A)."""
        return self.game.task_reward
