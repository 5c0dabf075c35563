"""Cost models: how omega becomes what state-action pairs cost, and its gradient.

Policies are those of r_theta(s, a) - c_omega(s, a). In the paper -c_omega = omega^T phi; another model stands in its
place where an experiment's ``algorithm.cost`` names one. Tables and gradients here are of -c_omega, as omega^T phi is
added to the reward.
"""

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.factored import FactoredReward
from mabirds_core.games.interface import Visitation


class CostModel(Protocol):
    """A differentiable family of costs."""

    linear: bool
    """Does omega weigh the game's cost features, one number each?"""

    @property
    def size(self) -> int:
        """K_omega: length of omega."""
        ...

    @property
    def names(self) -> tuple[str, ...]:
        """Of omega's entries, for people; empty where they have no meaning of their own."""
        ...

    @property
    def counts(self) -> bool | Mask:
        """Are its gradients counts, which are never negative? All of them, or those of a mask, shape (K_omega,)."""
        ...

    @property
    def total_size(self) -> int:
        """K_c: length of the totals, at least as many as there are cost features."""
        ...

    def initial(self, rng: np.random.Generator) -> Vector:
        """omega(1), shape (K_omega,): every pair costs the same."""
        ...

    def total(self, visitation: Visitation) -> Vector:
        """What gradients hang on, summed; shape (K_c,), totals of the game's cost features first."""
        ...

    def gradient_of_total(self, omega: Vector, total: Vector) -> Vector:
        """The gradient of what is earned by -c_omega.

        Parameters
        ----------
        omega : Vector
            Shape (K_omega,).
        total : Vector
            As of ``total``, shape (K_c,).

        Returns
        -------
        Vector
            sum_k weights[k] grad -c_omega(states[k], actions[k]), shape (K_omega,).
        """
        ...

    def penalty_gradient(self, omega: Vector) -> Vector:
        """Gradient of what is added to the loss for omega alone, shape (K_omega,)."""
        ...

    def table(self, omega: Vector) -> Array:
        """-c_omega(s, a) for every pair of a tabular game, shape (S, A)."""
        ...

    def factored(self, omega: Vector) -> FactoredReward | None:
        """-c_omega(s, a) by expert; None where it does not factorise."""
        ...

    def by_feature(self, omega: Vector) -> Vector:
        """What omega says of the game's cost features, as weights of them; shape (K,). For people and tests."""
        ...


@dataclass(frozen=True)
class LinearCost:
    """-c_omega = omega^T phi, as in the paper. omega(1) = 0.

    Attributes
    ----------
    features : Any
        phi, a ``games.interface.FeatureMap``.
    """

    features: Any
    linear = True

    @property
    def size(self) -> int:
        """Number of cost features."""
        return len(self.features.names)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the features."""
        return tuple(self.features.names)

    @property
    def counts(self) -> bool | Mask:
        """As the features say; where they do not, all if they are never negative."""
        counts: bool | Mask = getattr(self.features, "counts", bool(getattr(self.features, "nonnegative", False)))
        return counts

    @property
    def total_size(self) -> int:
        """Number of cost features."""
        return self.size

    def initial(self, rng: np.random.Generator) -> Vector:  # noqa: ARG002 - other models draw from it
        """Zeros, shape (K,)."""
        return np.zeros(self.size)

    def total(self, visitation: Visitation) -> Vector:
        """Totals of the features, shape (K,)."""
        total: Vector = self.features.total(visitation)
        return total

    def gradient_of_total(self, omega: Vector, total: Vector) -> Vector:  # noqa: ARG002 - linear in omega
        """The total itself, shape (K,)."""
        return total

    def penalty_gradient(self, omega: Vector) -> Vector:
        """No penalty: zeros, shape (K,)."""
        return np.zeros_like(omega)

    def table(self, omega: Vector) -> Array:
        """omega^T phi(s, a), shape (S, A)."""
        table: Array = self.features.table(omega)
        return table

    def factored(self, omega: Vector) -> FactoredReward | None:
        """omega^T phi(s, a) by expert, where the features say how."""
        if not hasattr(self.features, "factored"):
            return None
        factored: FactoredReward = self.features.factored(omega)
        return factored

    def by_feature(self, omega: Vector) -> Vector:
        """omega itself."""
        return omega


def costs_of(game: Any) -> CostModel:
    """The cost model of a game.

    Parameters
    ----------
    game : Any
        A ``games.interface.ConstrainedMarkovGame``.

    Returns
    -------
    CostModel
        What the experiment gave it (``cost_model``), or omega^T phi.
    """
    model: CostModel | None = getattr(game, "cost_model", None)
    return model or LinearCost(game.cost_features)
