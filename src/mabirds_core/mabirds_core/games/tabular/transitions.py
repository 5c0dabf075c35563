"""What follows joint states and actions: a single state, or one of several where experts slip.

    P(s' | s, a) = prod_i K_i(c_i' | c_i, m_i),   K_i = (1 - slip) [c_i' where m_i leads] + slip/M sum_m [where m leads]

Experts slip independently of each other, so that expectations are taken one expert after the other: N_E means over M
moves in place of one over all M^N_E joint outcomes. The same means carry probability forwards, K_i being symmetric in
the move that is chosen and the move that is made.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector, weighted_counts


@dataclass(frozen=True)
class Deterministic:
    """Every pair leads to a single state.

    Attributes
    ----------
    table : Callable[[], Indices]
        Gives the successors, shape (S, A): games whose policies are found by expert never ask for so large a table.
    deterministic : bool
        True.
    """

    table: Callable[[], Indices]
    deterministic: ClassVar[bool] = True

    @property
    def successor(self) -> Indices:
        """Shape (S, A)."""
        return self.table()

    def expected(self, values: Vector, states: Indices | slice) -> Array:
        """The values of the successors, shape (M, A)."""
        return np.asarray(values[self.successor[states]])

    def onward(self, pairs: Array, states: Indices | slice) -> Vector:
        """Probabilities of the successors, shape (S,)."""
        return weighted_counts(self.successor[states], pairs, len(self.successor))

    def draw(self, states: Indices, actions: Indices, rng: np.random.Generator) -> Indices:  # noqa: ARG002
        """The successors; nothing is drawn."""
        return np.asarray(self.successor[states, actions])


@dataclass(frozen=True)
class Slipping:
    """Each expert makes any of its M moves, all equally likely, with probability ``slip`` in place of the one it chose.

    Attributes
    ----------
    chosen : Deterministic
        Where moves lead that are made as chosen.
    n_experts : int
        N_E.
    n_moves : int
        M.
    slip : float
        In (0, 1).
    deterministic : bool
        False.
    """

    chosen: Deterministic
    n_experts: int
    n_moves: int
    slip: float
    deterministic: ClassVar[bool] = False

    def expected(self, values: Vector, states: Indices | slice) -> Array:
        """Means over what the experts make of their choices, shape (M, A)."""
        return self._mixed(self.chosen.expected(values, states))

    def onward(self, pairs: Array, states: Indices | slice) -> Vector:
        """Probabilities of the states after, shape (S,)."""
        return self.chosen.onward(self._mixed(pairs), states)

    def draw(self, states: Indices, actions: Indices, rng: np.random.Generator) -> Indices:
        """Who slips is drawn first, then all moves that may be made instead."""
        shape = (self.n_moves,) * self.n_experts
        moves = np.stack(np.unravel_index(actions, shape))
        slips = rng.random(moves.shape) < self.slip
        made = np.where(slips, rng.integers(self.n_moves, size=moves.shape), moves)
        return self.chosen.draw(states, np.ravel_multi_index(tuple(made), shape), rng)

    def _mixed(self, pairs: Array) -> Array:
        """Every entry mixed with the mean over the moves of one expert, then of the next; shape (M, A)."""
        mixed = pairs.reshape(len(pairs), *(self.n_moves,) * self.n_experts)
        for axis in range(1, mixed.ndim):
            mixed = (1 - self.slip) * mixed + self.slip * mixed.mean(axis=axis, keepdims=True)
        return mixed.reshape(pairs.shape)
