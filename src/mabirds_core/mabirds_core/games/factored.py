"""Games of experts who move independently of each other, so that solving them factorises (``planners/factored``).

    R(s, a) = sum_i w_i(c_i, m_i) + D(s) + W[level(s, a)]

Expert i stands in one of n cells c_i and makes one of M moves m_i. A joint state is the mixed-radix number of the cells
(expert 1 most significant), a joint action that of the moves. D couples the experts through where they are; W through
what they do, in the few coupled states; everywhere else the level is 0, and W[0] = 0.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Array, Indices, Vector, digits, undigits
from mabirds_core.games.interface import TabularGame

MOST_LEVELS = 256
"""They are kept as bytes."""


class Ways(NamedTuple):
    """All joint actions of a level above 0, in the order of ``coupled_states``.

    Attributes
    ----------
    levels : NDArray[np.uint8]
        Shape (K,).
    state : Indices
        Which of the coupled states, shape (K,).
    after : Indices
        The joint state after, shape (K,).
    entries : Indices
        Where each expert's move is in an array of shape (N_E, n, M), shape (K, N_E).
    """

    levels: NDArray[np.uint8]
    state: Indices
    after: Indices
    entries: Indices


@dataclass(frozen=True)
class Factors:
    """The dynamics of such a game.

    Attributes
    ----------
    successor : Indices
        successor[i, c, m]: where move m takes expert i from cell c, shape (N_E, n, M).
    coupled_states : Indices
        In rising order, shape (C,).
    coupled_levels : NDArray[np.uint8]
        The level of each joint action there, shape (C, A).
    """

    successor: Indices
    coupled_states: Indices
    coupled_levels: NDArray[np.uint8]

    @property
    def n_experts(self) -> int:
        """N_E."""
        return len(self.successor)

    @property
    def n_cells(self) -> int:
        """n."""
        return int(self.successor.shape[1])

    @property
    def n_moves(self) -> int:
        """M."""
        return int(self.successor.shape[2])

    @property
    def n_states(self) -> int:
        """S = n^N_E."""
        return int(self.n_cells**self.n_experts)

    def cells(self, states: Indices) -> Indices:
        """Each expert's cells in joint states of any shape, one array each."""
        return digits(states, self.n_cells, self.n_experts)

    def moves(self, actions: Indices) -> Indices:
        """Each expert's moves in joint actions of any shape, one array each."""
        return digits(actions, self.n_moves, self.n_experts)

    @cached_property
    def ways(self) -> Ways:
        """Joint actions of a level above 0."""
        state, action = np.nonzero(self.coupled_levels)
        experts = np.arange(self.n_experts)[:, None]
        cells, moves = self.cells(self.coupled_states[state]), self.moves(action)
        entries = (experts * self.n_cells + cells) * self.n_moves + moves
        after = self.after(self.coupled_states[state], action)
        return Ways(self.coupled_levels[state, action], state, after, entries.T)

    @cached_property
    def offsets(self) -> tuple[Indices, Indices]:
        """By how many cells moves of the last expert lead on, each once, and which of them is each, shape (n, M)."""
        offset, which = np.unique(self.successor[-1] - np.arange(self.n_cells)[:, None], return_inverse=True)
        return offset, which

    def after(self, states: Indices, actions: Indices) -> Indices:
        """Where joint actions lead.

        Parameters
        ----------
        states : Indices
            Joint states.
        actions : Indices
            Joint actions, of a shape that broadcasts with theirs.

        Returns
        -------
        Indices
            The joint states after, of the shape of both.
        """
        own = zip(self.successor, self.cells(states), self.moves(actions), strict=True)
        return undigits([successor[cell, move] for successor, cell, move in own], self.n_cells)

    def levels(self, states: Indices) -> NDArray[np.uint8]:
        """The level of every joint action in M joint ``states``, shape (M, A)."""
        levels = np.zeros((len(states), self.n_moves**self.n_experts), dtype=np.uint8)
        if len(self.coupled_states):
            places = np.minimum(np.searchsorted(self.coupled_states, states), len(self.coupled_states) - 1)
            coupled = self.coupled_states[places] == states
            levels[coupled] = self.coupled_levels[places[coupled]]
        return levels


class FactoredReward(NamedTuple):
    """A reward of such a game.

    Attributes
    ----------
    moves : Array
        w[i, c, m], shape (N_E, n, M).
    states : Vector
        D, shape (S,).
    levels : Vector
        W, shape (L,); W[0] = 0.
    """

    moves: Array
    states: Vector
    levels: Vector

    def plus(self, other: "FactoredReward") -> "FactoredReward":
        """The sum of two rewards."""
        return FactoredReward(self.moves + other.moves, self.states + other.states, self.levels + other.levels)


class FactoredGame(TabularGame, Protocol):
    """A tabular game of independent movers."""

    @property
    def factors(self) -> Factors:
        """Its dynamics."""
        ...
