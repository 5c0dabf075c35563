"""Reward models r_theta: how theta becomes a reward, and its gradient (paper, section 3 and Assumption 1)."""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import FeatureMap, Visitation


class RewardModel(Protocol):
    """A differentiable family of rewards of a tabular game."""

    @property
    def size(self) -> int:
        """Length of theta."""
        ...

    def initial(self, rng: np.random.Generator) -> Vector:
        """theta(1), shape (size,)."""
        ...

    def table(self, theta: Vector) -> Array:
        """r_theta(s, a) for every pair, shape (S, A)."""
        ...

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        """grad J: sum_k weights[k] grad_theta r_theta(states[k], actions[k]), shape (size,)."""
        ...


@dataclass(frozen=True)
class LinearReward:
    """r_theta(s, a) = theta^T f(s, a); its gradient does not depend on theta. theta(1) = 0."""

    features: FeatureMap

    @property
    def size(self) -> int:
        """Number of reward features."""
        return len(self.features.names)

    def initial(self, rng: np.random.Generator) -> Vector:  # noqa: ARG002 - other models draw from it
        """Zeros: every policy looks alike."""
        return np.zeros(self.size)

    def table(self, theta: Vector) -> Array:
        """theta^T f(s, a), shape (S, A)."""
        return self.features.table(theta)

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:  # noqa: ARG002 - linear in theta
        """The visitation's total of the features, shape (size,)."""
        return self.features.total(visitation)
