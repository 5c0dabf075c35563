"""Rewards of patrollers who must not come too late: a parameter of its own for being under way at the end.

That an expert is late, under way after step T, is a sum over its moves,

    gamma^{T+1} 1[c_{T+1} != g] = 1 + sum_t gamma^t ( gamma 1[c_{t+1} != g] - 1[c_t != g] ),

a potential's telescoping sum, so that weights of the moves alone can say what lateness costs: all of them, a little
each. Step rules move coordinate by coordinate. What is never demonstrated, and what the policy does seldom, has to be a
coordinate of its own for them to see it, as cells have that nobody enters.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_core.arithmetic import powers
from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import Visitation
from mabirds_core.games.patrol.features import PatrolRewardFeatures
from mabirds_core.games.patrol.geometry import PatrolGrid

LATE_SCALE = 10.0
"""Experts are late seldom, and a larger feature learns faster."""


def lateness(grid: PatrolGrid, discount: float, horizon: int) -> Array:
    """What each move of each expert adds to its being late.

    Parameters
    ----------
    grid : PatrolGrid
        Where moves lead, and where experts have arrived.
    discount : float
        gamma.
    horizon : int
        T.

    Returns
    -------
    Array
        Shape (N_E, n, M). Its gamma^t-weighted sum over a trajectory t = 0..T that begins under way is
        gamma^{T+1} LATE_SCALE where the expert does not arrive, and 0 where it does. The 1 of the telescoping sum is
        spread evenly over the steps.
    """
    steps = powers(discount, horizon + 1).sum()
    under_way = (~grid.is_goal).astype(np.float64)
    after = under_way[np.arange(grid.n_experts)[:, None, None], grid.expert_successor]
    return np.asarray(LATE_SCALE * (discount * after - under_way[:, :, None] + 1 / steps))


@dataclass(frozen=True)
class ArrivingReward:
    """r_theta(s, a) = w(theta)^T f(s, a) with f the moves' indicators and theta = (u, v):

        w_{i,c,m} = u_{i,c,m} + v_i late_{i,c,m}

    Attributes
    ----------
    features : PatrolRewardFeatures
        f, shape (K,) at each state-action pair.
    late : Array
        By ``lateness``, shape (N_E, n, M).
    """

    features: PatrolRewardFeatures
    late: Array
    counts = True

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Of theta's entries: moves, then lateness, expert by expert."""
        return (*self.features.names, *(f"expert_{expert + 1} late" for expert in range(len(self.late))))

    @property
    def size(self) -> int:
        """K + N_E."""
        return self.total_size + len(self.late)

    @property
    def total_size(self) -> int:
        """K: number of moves."""
        return self.late.size

    def initial(self, rng: np.random.Generator) -> Vector:  # noqa: ARG002 - nothing to draw
        """Zeros, shape (size,): every policy looks alike."""
        return np.zeros(self.size)

    def weights(self, theta: Vector) -> Vector:
        """w(theta), shape (K,)."""
        moves, late = theta[: self.late.size], theta[self.late.size :]
        return moves + (late[:, None, None] * self.late).ravel()

    def table(self, theta: Vector) -> Array:
        """r_theta(s, a), shape (S, A)."""
        return self.features.table(self.weights(theta))

    def total(self, visitation: Visitation) -> Vector:
        """The visitation's total of f, shape (K,)."""
        return self.features.total(visitation)

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        """Total of the moves, and of being late, shape (size,)."""
        return self.gradient_of_total(theta, self.total(visitation))

    def gradient_of_total(self, theta: Vector, total: Vector) -> Vector:  # noqa: ARG002 - linear in theta
        """The same from a total of the moves; rounding may leave a count below 0 by some 1e-14."""
        late = (total.reshape(self.late.shape) * self.late).sum(axis=(1, 2))
        return np.concatenate([total, np.maximum(late, 0.0)])
