"""A reward model whose theta also says which cost features some learner has been shown.

    theta = (u, s),     r_theta = r_u,     s_k = share of the learners that have been shown cost feature k

Learner v takes a step of 1 along s_k when a demonstration of its own has feature k for the first time, and none
otherwise: no gradient has an entry there. Mixing keeps sums, so that s_k tends to the share, is positive wherever word
of it has come, and stays 0 for what nobody has shown. Whoever asks for constraints (``games.tabular.constraint_test``)
so knows of all demonstrations what it needs to know, whether any of them had feature k.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.interface import ShownFeatures, TabularFeatureMap, Visitation
from mabirds_core.rewards.models import SummableReward, TabularRewardModel


class WeighingReward(SummableReward, TabularRewardModel, Protocol):
    """A reward of a tabular game that weighs features, and is summed by their totals."""

    @property
    def features(self) -> TabularFeatureMap:
        """f."""
        ...

    @property
    def counts(self) -> bool:
        """Are its gradients counts, which are never negative?"""
        ...

    def weights(self, theta: Vector) -> Vector:
        """Of the features, shape (K_f,)."""
        ...


@dataclass(frozen=True)
class RewardWithShown:
    """r_u(s, a) with theta = (u, s).

    Attributes
    ----------
    reward : WeighingReward
        r_u.
    cost_names : tuple[str, ...]
        Of the cost features, K of them.
    """

    reward: WeighingReward
    cost_names: tuple[str, ...]

    @property
    def features(self) -> TabularFeatureMap:
        """f of r_u."""
        return self.reward.features

    @property
    def counts(self) -> bool:
        """As of r_u; entries of s are 0."""
        return self.reward.counts

    @property
    def names(self) -> tuple[str, ...]:
        """Of theta's entries: those of r_u, then who was shown what."""
        own: tuple[str, ...] = getattr(self.reward, "names", self.reward.features.names)
        return (*own, *(f"shown: {name}" for name in self.cost_names))

    @property
    def size(self) -> int:
        """That of u, and K."""
        return self.reward.size + len(self.cost_names)

    @property
    def total_size(self) -> int:
        """K_f, as of r_u."""
        return self.reward.total_size

    def initial(self, rng: np.random.Generator) -> Vector:
        """u(1), and nothing shown; shape (size,)."""
        return self._with_zeros(self.reward.initial(rng))

    def weights(self, theta: Vector) -> Vector:
        """Of f by u, shape (K_f,)."""
        return self.reward.weights(self._split(theta)[0])

    def table(self, theta: Vector) -> Array:
        """r_u(s, a), shape (S, A)."""
        return self.reward.table(self._split(theta)[0])

    def total(self, visitation: Visitation) -> Vector:
        """The visitation's total of f, shape (K_f,)."""
        return self.reward.total(visitation)

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        """grad J of r_u, then zeros; shape (size,)."""
        return self._with_zeros(self.reward.gradient(self._split(theta)[0], visitation))

    def gradient_of_total(self, theta: Vector, total: Vector) -> Vector:
        """The same from a total of f."""
        return self._with_zeros(self.reward.gradient_of_total(self._split(theta)[0], total))

    def told(self, step: Vector, news: Mask) -> Vector:
        """A step that also tells what was shown for the first time.

        Parameters
        ----------
        step : Vector
            What the step rule takes off theta, shape (size,).
        news : Mask
            Cost features that the newest demonstration had, and none before, shape (K,).

        Returns
        -------
        Vector
            The step with -1 along those entries of s.
        """
        own, shown = self._split(step)
        return np.concatenate([own, shown - news])

    def shown(self, theta: Vector, demonstrations: int) -> ShownFeatures:
        """What was shown in the network, as far as theta knows.

        Parameters
        ----------
        theta : Vector
            Shape (size,).
        demonstrations : int
            Of all learners together.

        Returns
        -------
        ShownFeatures
            Those with s_k > 0.
        """
        return ShownFeatures(self._split(theta)[1] > 0, demonstrations)

    def _split(self, theta: Vector) -> tuple[Vector, Vector]:
        """u and s."""
        return theta[: self.reward.size], theta[self.reward.size :]

    def _with_zeros(self, own: Vector) -> Vector:
        return np.concatenate([own, np.zeros(len(self.cost_names))])
