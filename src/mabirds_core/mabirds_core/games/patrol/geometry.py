"""Where patrollers can be and go: the grid, joint states and actions as numbers, and what leads where."""

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mabirds_core.arrays import Indices, Mask, digits, undigits
from mabirds_core.games.factored import Factors

STRAIGHT = {"north": (-1, 0), "east": (0, 1), "south": (1, 0), "west": (0, -1)}
"""Moves as (rows, columns)."""
WAITING = {"nowhere": (0, 0)}
DIAGONALS = {"northeast": (-1, 1), "southeast": (1, 1), "southwest": (1, -1), "northwest": (-1, -1)}

SWAP_BLOCK = 4096
"""Joint states at a time, of which all joint actions are looked at."""

Cell = tuple[int, int]


@dataclass(frozen=True)
class PatrolGrid:
    """A map of n = height * width cells on which N_E experts walk, each to its own absorbing goal.

    A joint state is the mixed-radix number of the experts' cells (expert 1 most significant), a cell the index
    row * width + column; joint actions likewise. S = n^N_E, A = M^N_E: the M moves are the four straight ones, then
    waiting, then the four diagonal ones, as far as the game has them.

    Attributes
    ----------
    height : int
        Rows.
    width : int
        Columns.
    goal_cells : tuple[tuple[Cell, ...], ...]
        (row, column) of the cells of each expert's goal.
    waiting : bool
        Experts may stay where they are.
    diagonals : bool
        Experts may move diagonally.
    leaving : bool
        Who has arrived is gone, and shares no cell with anybody.
    slip : float
        Chance that an expert makes any of its moves, all equally likely, in place of the one it chose.
    """

    height: int
    width: int
    goal_cells: tuple[tuple[Cell, ...], ...]
    waiting: bool = False
    diagonals: bool = False
    leaving: bool = False
    slip: float = 0.0

    @property
    def dynamics(self) -> dict[str, Any]:
        """What decides trajectories, as JSON can write it: without options at their defaults, which came later."""
        goals = tuple(cells[0] if len(cells) == 1 else cells for cells in self.goal_cells)
        options = {name: getattr(self, name) for name in ("waiting", "diagonals", "leaving", "slip")}
        given = {name: value for name, value in options.items() if value}
        return {"height": self.height, "width": self.width, "goal_cells": goals, **given}

    @cached_property
    def steps_of_moves(self) -> dict[str, Cell]:
        """(rows, columns) of every move by its name."""
        return STRAIGHT | (WAITING if self.waiting else {}) | (DIAGONALS if self.diagonals else {})

    @property
    def move_names(self) -> tuple[str, ...]:
        """Of the M moves."""
        return tuple(self.steps_of_moves)

    @property
    def n_moves(self) -> int:
        """M."""
        return len(self.steps_of_moves)

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
        return int(self.n_moves**self.n_experts)

    @cached_property
    def is_goal(self) -> Mask:
        """is_goal[i, c]: expert i has arrived in cell c, shape (N_E, n)."""
        goals = np.zeros((self.n_experts, self.n_cells), dtype=np.bool_)
        for expert, cells in enumerate(self.goal_cells):
            goals[expert, [self.cell_index(cell) for cell in cells]] = True
        return goals

    @cached_property
    def present(self) -> Mask:
        """present[i, c]: expert i is really in cell c, and has not left there; shape (N_E, n)."""
        return ~self.is_goal if self.leaving else np.ones_like(self.is_goal)

    @cached_property
    def first_cells(self) -> Indices:
        """Where each expert's cells begin where all are numbered one after the other, shape (N_E, 1)."""
        return np.arange(self.n_experts)[:, None] * self.n_cells

    def cell_index(self, cell: Cell) -> int:
        """row * width + column."""
        return cell[0] * self.width + cell[1]

    def cells(self, states: NDArray[np.integer]) -> Indices:
        """The experts' cells in joint ``states`` of any shape: (N_E, *states.shape)."""
        return digits(states, self.n_cells, self.n_experts)

    def moves(self, actions: NDArray[np.integer]) -> Indices:
        """The experts' moves in joint ``actions`` of any shape: (N_E, *actions.shape)."""
        return digits(actions, self.n_moves, self.n_experts)

    def joint_state(self, cells: NDArray[np.integer]) -> Indices:
        """Inverse of ``cells``."""
        return undigits(cells, self.n_cells)

    def joint_action(self, moves: NDArray[np.integer]) -> Indices:
        """Inverse of ``moves``."""
        return undigits(moves, self.n_moves)

    @cached_property
    def expert_successor(self) -> Indices:
        """expert_successor[i, c, a]: where move a takes expert i from cell c, shape (N_E, n, M)."""
        rows, columns = np.divmod(np.arange(self.n_cells), self.width)
        position = np.stack([rows, columns], axis=-1)[:, None, :] + [*self.steps_of_moves.values()]
        inside = ((position >= 0) & (position < [self.height, self.width])).all(axis=-1)
        stay = np.arange(self.n_cells)[:, None]
        moved = np.where(inside, position[..., 0] * self.width + position[..., 1], stay)
        return np.where(self.is_goal[:, :, None], stay, moved)

    @cached_property
    def midways(self) -> Indices:
        """midways[i, c, a]: a number for the place halfway between a cell and the one after, shape (N_E, n, M)."""
        rows, columns = np.divmod(np.arange(self.n_cells), self.width)
        doubled = 2 * self.width * rows + columns  # of two cells, the sum says where they lie, as columns carry nothing
        return np.asarray(doubled[:, None] + doubled[self.expert_successor])

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
            count += (cells[i] == cells[j]) & self.present[i][cells[i]] & self.present[j][cells[j]]
        return count

    @cached_property
    def swapping(self) -> NDArray[np.int8]:
        """swapping[s, a]: pairs of experts that would pass through each other, shape (S, A)."""
        return self.swapping_in(np.arange(self.n_states)[:, None], np.arange(self.n_actions))

    def swapping_in(self, states: NDArray[np.integer], actions: NDArray[np.integer]) -> NDArray[np.int8]:
        """Count pairs of experts whose moves, as chosen, exchange their cells, or cross each other diagonally.

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
        return self.swapping_of(self.cells(states), self.moves(actions))

    def swapping_of(self, cells: Indices, moves: Indices) -> NDArray[np.int8]:
        """The same of each expert's cells and moves.

        Parameters
        ----------
        cells : Indices
            Shape (N_E, ...).
        moves : Indices
            Of a shape that broadcasts with theirs.

        Returns
        -------
        NDArray[np.int8]
            Pairs.
        """
        midways = [table[own, made] for table, own, made in zip(self.midways, cells, moves, strict=True)]
        count = np.zeros(midways[0].shape, dtype=np.int8)
        for i, j in self._pairs:
            count += (midways[i] == midways[j]) & (cells[i] != cells[j])
        return count

    @cached_property
    def factors(self) -> Factors:
        """Experts move each for itself; where two can swap, the pairs that do are the level of a joint action."""
        states, actions = np.flatnonzero(self._can_swap()), np.arange(self.n_actions)
        blocks = np.split(states, range(SWAP_BLOCK, len(states), SWAP_BLOCK))
        levels = np.concatenate([self.swapping_in(block[:, None], actions) for block in blocks])
        return Factors(self.expert_successor, states, levels.astype(np.uint8))

    def _can_swap(self) -> NDArray[np.bool_]:
        """Joint states in which moves of two experts can lead through each other, shape (S,)."""
        shape, states = (self.n_cells,) * self.n_experts, np.zeros(self.n_states, dtype=np.bool_)
        for i, j in self._pairs:
            apart = [self.n_cells if k in {i, j} else 1 for k in range(self.n_experts)]
            states |= np.broadcast_to(self._can_meet_midway(i, j).reshape(apart), shape).ravel()
        return states

    def _can_meet_midway(self, i: int, j: int) -> Mask:
        """By the cells of two experts, shape (n, n)."""
        met = np.zeros((self.n_cells, self.n_cells), dtype=np.bool_)
        for one, other in product(self.midways[i].T, self.midways[j].T):
            met |= one[:, None] == other
        np.fill_diagonal(met, val=False)
        return met

    @property
    def n_pairs(self) -> int:
        """Pairs of experts."""
        return len(self._pairs)

    @cached_property
    def _pairs(self) -> list[tuple[int, int]]:
        return list(combinations(range(self.n_experts), 2))
