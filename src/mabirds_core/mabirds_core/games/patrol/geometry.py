"""Where patrollers can be and go: the grid, joint states and actions as numbers, and what leads where."""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Indices, digits
from mabirds_core.games.factored import Factors

MOVE_NAMES = ("north", "east", "south", "west")
N_MOVES = len(MOVE_NAMES)
MOVES = np.array([[-1, 0], [0, 1], [1, 0], [0, -1]])
"""North, east, south, west as (rows, columns)."""

SWAP_BLOCK = 4096
"""Joint states at a time, of which all joint actions are looked at."""

Cell = tuple[int, int]


@dataclass(frozen=True)
class PatrolGrid:
    """A map of n = height * width cells on which N_E experts walk, each to its own absorbing goal.

    A joint state is the mixed-radix number of the experts' cells (expert 1 most significant), a cell the index
    row * width + column; joint actions likewise. S = n^N_E, A = 4^N_E.

    Attributes
    ----------
    height : int
        Rows.
    width : int
        Columns.
    goal_cells : tuple[Cell, ...]
        (row, column) of each expert's goal.
    """

    height: int
    width: int
    goal_cells: tuple[Cell, ...]

    @property
    def n_cells(self) -> int:
        """n."""
        return self.height * self.width

    @property
    def n_experts(self) -> int:
        """N_E."""
        return len(self.goal_cells)

    @property
    def n_states(self) -> int:
        """S."""
        return int(self.n_cells**self.n_experts)

    @property
    def n_actions(self) -> int:
        """A."""
        return int(N_MOVES**self.n_experts)

    @cached_property
    def goals(self) -> Indices:
        """The experts' goal cells, shape (N_E,)."""
        return np.array([self.cell_index(cell) for cell in self.goal_cells])

    def cell_index(self, cell: Cell) -> int:
        """row * width + column."""
        return cell[0] * self.width + cell[1]

    def cells(self, states: NDArray[np.integer]) -> Indices:
        """The experts' cells in joint ``states`` of any shape: (N_E, *states.shape)."""
        return digits(states, self.n_cells, self.n_experts)

    def moves(self, actions: NDArray[np.integer]) -> Indices:
        """The experts' moves in joint ``actions`` of any shape: (N_E, *actions.shape)."""
        return digits(actions, N_MOVES, self.n_experts)

    def joint_state(self, cells: NDArray[np.integer]) -> Indices:
        """Inverse of ``cells``."""
        return np.asarray(np.ravel_multi_index(tuple(cells), (self.n_cells,) * self.n_experts))

    @cached_property
    def expert_successor(self) -> Indices:
        """expert_successor[i, c, a]: where move a takes expert i from cell c, shape (N_E, n, 4)."""
        rows, columns = np.divmod(np.arange(self.n_cells), self.width)
        position = np.stack([rows, columns], axis=-1)[:, None, :] + MOVES
        inside = ((position >= 0) & (position < [self.height, self.width])).all(axis=-1)
        stay = np.arange(self.n_cells)[:, None]
        moved = np.where(inside, position[..., 0] * self.width + position[..., 1], stay)
        absorbing = np.arange(self.n_cells)[:, None] == self.goals[:, None, None]
        return np.where(absorbing, stay, moved)

    def _cells_after(self) -> list[Indices]:
        """The cell after each joint (s, a), one (S, A) array per expert."""
        cells, moves = self.cells(np.arange(self.n_states)), self.moves(np.arange(self.n_actions))
        return [
            table[own_cells[:, None], own_moves]
            for table, own_cells, own_moves in zip(self.expert_successor, cells, moves, strict=True)
        ]

    @cached_property
    def successor(self) -> Indices:
        """successor[s, a], shape (S, A)."""
        return self.joint_state(np.stack(self._cells_after()))

    @cached_property
    def sharing(self) -> Indices:
        """sharing[s]: pairs of experts in one cell, shape (S,)."""
        cells = self.cells(np.arange(self.n_states))
        count = np.zeros(self.n_states, dtype=np.int64)
        for i, j in self._pairs:
            count += cells[i] == cells[j]
        return count

    @cached_property
    def swapping(self) -> NDArray[np.int8]:
        """swapping[s, a]: pairs of experts that exchange their cells, shape (S, A)."""
        return self.swapping_in(np.arange(self.n_states)[:, None], np.arange(self.n_actions))

    def swapping_in(self, states: NDArray[np.integer], actions: NDArray[np.integer]) -> NDArray[np.int8]:
        """Count pairs of experts that exchange their cells.

        Parameters
        ----------
        states : NDArray[np.integer]
            Joint states.
        actions : NDArray[np.integer]
            Joint actions, of a shape that broadcasts with theirs.

        Returns
        -------
        NDArray[np.int8]
            Pairs, of the shape of both.
        """
        cells, moves = self.cells(states), self.moves(actions)
        after = [table[own, made] for table, own, made in zip(self.expert_successor, cells, moves, strict=True)]
        count = np.zeros(np.broadcast_shapes(states.shape, actions.shape), dtype=np.int8)
        for i, j in self._pairs:
            count += (after[i] == cells[j]) & (after[j] == cells[i]) & (cells[i] != cells[j])
        return count

    @cached_property
    def factors(self) -> Factors:
        """Experts move each for itself; where two can swap, the pairs that do are the level of a joint action."""
        states, actions = np.flatnonzero(self._can_swap()), np.arange(self.n_actions)
        blocks = np.split(states, range(SWAP_BLOCK, len(states), SWAP_BLOCK))
        levels = np.concatenate([self.swapping_in(block[:, None], actions) for block in blocks])
        return Factors(self.expert_successor, states, levels.astype(np.uint8))

    def _can_swap(self) -> NDArray[np.bool_]:
        """Joint states in which two experts are next to each other, and neither at its goal, shape (S,)."""
        cells = np.arange(self.n_cells)
        leads = (self.expert_successor[:, :, None, :] == cells[:, None]).any(axis=-1)
        leads[:, cells, cells] = False
        shape, states = (self.n_cells,) * self.n_experts, np.zeros(self.n_states, dtype=np.bool_)
        for i, j in self._pairs:
            apart = [self.n_cells if k in {i, j} else 1 for k in range(self.n_experts)]
            states |= np.broadcast_to((leads[i] & leads[j].T).reshape(apart), shape).ravel()
        return states

    @property
    def n_pairs(self) -> int:
        """Pairs of experts."""
        return len(self._pairs)

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        return list(combinations(range(self.n_experts), 2))
