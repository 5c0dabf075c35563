"""The evader-patroller game (paper, section 5.1): experts walk on a grid map to their goals.

Each expert moves north, east, south or west; a move off the map stays in place; at its own goal an expert
stays for ever. Obstacle cells can be entered, which is what experts may not do. Two experts may neither share
a cell nor swap cells. Cells are (row, column), row 0 at the top.
"""

from functools import cached_property
from itertools import combinations
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, field_validator, model_validator

from mabirds_core.arrays import Array, Indices, Mask, Vector, weighted_counts
from mabirds_core.digest import digest
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.features import MOVE_NAMES, N_MOVES, PatrolCostFeatures, PatrolRewardFeatures
from mabirds_core.settings import Settings

MOVES = np.array([[-1, 0], [0, 1], [1, 0], [0, -1]])
"""North, east, south, west as (rows, columns)."""
MOST_PAIRS = 20_000_000
"""Joint state-action pairs that a learner can tabulate: some gigabytes."""
MOST_FLOAT = 10**300
"""Larger whole numbers cannot be written as floating-point ones."""
MOST_VALUES = 200_000_000
"""Values of joint states at all steps that a policy can keep: 1.6 gigabytes."""

Cell = tuple[int, int]


class PatrolSettings(Settings):
    """The game as written in an experiment file.

    >>> PatrolSettings(map="...", starts=[[(0, 0), (0, 2)]], goals=[(0, 2), (0, 0)], horizon=4).n_experts
    2
    """

    kind: Literal["patrol"] = "patrol"
    map: str = Field(description="rows of '.' (free) and '#' (obstacle), all of one length")
    starts: tuple[tuple[Cell, ...], ...] = Field(min_length=1, description="joint starts: one cell per expert")
    start_probabilities: tuple[float, ...] | None = Field(None, description="of the joint starts; default: uniform")
    goals: tuple[Cell, ...] = Field(min_length=1, description="one absorbing goal cell per expert, all different")
    horizon: int = Field(ge=1, le=10_000, description="T: trajectories have T + 1 steps")
    discount: float = Field(0.95, gt=0, le=1, description="gamma")
    joint_scale: float = Field(1.0, gt=0, le=1000, description="of the features for sharing and swapping cells")
    step_cost: float = Field(1.0, ge=0, le=1000, description="true reward: minus this a step for each expert under way")
    deadline: int | None = Field(None, ge=0, description="step by which experts arrive; default: the horizon")

    @field_validator("map")
    @classmethod
    def _map_is_a_rectangle(cls, text: str) -> str:
        rows = text.split()
        if not rows or any(len(row) != len(rows[0]) for row in rows) or set("".join(rows)) - set(".#"):
            raise ValueError("expected rows of '.' and '#' of one length")
        return "\n".join(rows)

    @model_validator(mode="after")
    def _deadline_is_a_step(self) -> "PatrolSettings":
        if self.deadline is not None and self.deadline > self.horizon:
            raise ValueError(f"deadline {self.deadline}: expected a step up to the horizon, {self.horizon}")
        return self

    @model_validator(mode="after")
    def _cells_fit(self) -> "PatrolSettings":
        rows = self.rows
        for cell in (*self.goals, *(cell for start in self.starts for cell in start)):
            _check_free(rows, cell)
        if len(set(self.goals)) != self.n_experts:
            raise ValueError(f"goals {self.goals}: expected a different goal for each expert")
        for start in self.starts:
            if len(start) != self.n_experts or len(set(start)) != self.n_experts:
                raise ValueError(f"start {start}: expected {self.n_experts} different cells, one an expert")
        self._check_probabilities()
        self._check_size()
        return self

    def _check_size(self) -> None:
        height, width = len(self.rows), len(self.rows[0])
        states = (height * width) ** self.n_experts
        pairs, values = states * N_MOVES**self.n_experts, states * (self.horizon + 2)
        experts = f"{self.n_experts} experts on a {height}x{width} map make"
        if pairs > MOST_PAIRS:
            raise ValueError(
                f"{experts} {min(pairs, MOST_FLOAT):.2g} joint state-action pairs, expected at most {MOST_PAIRS:.2g};"
                " take a smaller map or fewer experts"
            )
        if values > MOST_VALUES:
            raise ValueError(
                f"{experts} {states} joint states, {values:.2g} values in {self.horizon + 2} steps, expected at most"
                f" {MOST_VALUES:.2g}; take a shorter horizon, a smaller map or fewer experts"
            )

    def _check_probabilities(self) -> None:
        given = self.start_probabilities
        if given is not None and (
            len(given) != len(self.starts) or min(given) < 0 or not np.isclose(sum(given), 1, rtol=0, atol=1e-9)
        ):
            raise ValueError(f"start_probabilities {given}: expected {len(self.starts)} numbers >= 0 with sum 1")

    @property
    def rows(self) -> list[str]:
        """The map's rows from top to bottom."""
        return self.map.split("\n")

    @property
    def n_experts(self) -> int:
        """N_E."""
        return len(self.goals)


def _check_free(rows: list[str], cell: Cell) -> None:
    inside = 0 <= cell[0] < len(rows) and 0 <= cell[1] < len(rows[0])
    if not inside or rows[cell[0]][cell[1]] != ".":
        raise ValueError(f"cell {cell} as (row, column): expected a free cell of the {len(rows)}x{len(rows[0])} map")


class PatrolGame:
    """The tabular game of ``settings``: n cells, S = n^N_E joint states, A = 4^N_E joint actions.

    A joint state is the mixed-radix number of the experts' cells (expert 1 most significant), a cell the index
    row * width + column; joint actions likewise.
    """

    def __init__(self, settings: PatrolSettings) -> None:
        self.settings = settings
        self.height, self.width = len(settings.rows), len(settings.rows[0])
        self.n_cells = self.height * self.width
        self.n_experts = settings.n_experts
        self.n_states = self.n_cells**self.n_experts
        self.n_actions = N_MOVES**self.n_experts
        self.horizon = settings.horizon
        self.deadline = settings.horizon if settings.deadline is None else settings.deadline
        self.discount = settings.discount
        self.obstacles: Mask = np.array([cell == "#" for row in settings.rows for cell in row])
        self.goals: Indices = np.array([self.cell_index(cell) for cell in settings.goals])

    @cached_property
    def digest(self) -> str:
        """SHA-256 of the settings."""
        return digest(self.settings.model_dump(mode="json"))

    def cell_index(self, cell: Cell) -> int:
        """row * width + column."""
        return cell[0] * self.width + cell[1]

    def cells(self, states: NDArray[np.integer]) -> Indices:
        """The experts' cells in joint ``states`` of any shape: (N_E, *states.shape)."""
        return np.array(np.unravel_index(states, (self.n_cells,) * self.n_experts))

    def moves(self, actions: NDArray[np.integer]) -> Indices:
        """The experts' moves in joint ``actions`` of any shape: (N_E, *actions.shape)."""
        return np.array(np.unravel_index(actions, (N_MOVES,) * self.n_experts))

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
        """The cell after each joint (s, a), one (S, A) array an expert."""
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
        cells, after = self.cells(np.arange(self.n_states))[:, :, None], self._cells_after()
        count = np.zeros((self.n_states, self.n_actions), dtype=np.int8)
        for i, j in self._pairs:
            count += (after[i] == cells[j]) & (after[j] == cells[i]) & (cells[i] != cells[j])
        return count

    @property
    def _pairs(self) -> list[tuple[int, int]]:
        return list(combinations(range(self.n_experts), 2))

    @cached_property
    def cost_features(self) -> PatrolCostFeatures:
        """phi: an indicator a cell and expert, pairs sharing, pairs swapping."""
        return PatrolCostFeatures(self)

    @cached_property
    def reward_features(self) -> PatrolRewardFeatures:
        """An indicator an expert, cell and move."""
        return PatrolRewardFeatures(self)

    @cached_property
    def true_constraints(self) -> Mask:
        """Obstacle cells of every expert, sharing and swapping; shape of the cost features."""
        joint = np.full(2, self.n_experts > 1)
        return np.concatenate([np.tile(self.obstacles, self.n_experts), joint])

    @cached_property
    def violation(self) -> Mask:
        """violation[s, a]: an expert on an obstacle, two in one cell, or two swapping."""
        on_obstacle = self.obstacles[self.cells(np.arange(self.n_states))].any(axis=0)
        of_state: Mask = on_obstacle | (self.sharing > 0)
        return of_state[:, None] | (self.swapping > 0)

    @cached_property
    def _arrived(self) -> Mask:
        return np.equal(self.cells(np.arange(self.n_states)), self.goals[:, None])

    @cached_property
    def goal(self) -> Mask:
        """goal[s]: every expert is at its goal."""
        return np.asarray(self._arrived.all(axis=0))

    @cached_property
    def task_reward(self) -> Array:
        """-step_cost a step for each expert that has not arrived, shape (S, A)."""
        waiting = (~self._arrived).sum(axis=0)
        return np.repeat(-self.settings.step_cost * waiting[:, None], self.n_actions, axis=1)

    @cached_property
    def initial_distribution(self) -> Vector:
        """P_0 over joint states."""
        starts = [[self.cell_index(cell) for cell in start] for start in self.settings.starts]
        states = self.joint_state(np.array(starts).T)
        weights = self.settings.start_probabilities or [1 / len(starts)] * len(starts)
        return weighted_counts(states, np.asarray(weights) / sum(weights), self.n_states)

    def encode(self, trajectory: Trajectories) -> tuple[Array, Array]:
        """States as row and column of each expert (T + 1, 2 N_E), actions as each expert's move (T + 1, N_E)."""
        cells = self.cells(trajectory.states[0])
        positions = np.stack(np.divmod(cells, self.width), axis=1)
        states = positions.reshape(2 * self.n_experts, -1).T
        return states.astype(np.float64), self.moves(trajectory.actions[0]).T.astype(np.float64)

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """Inverse of ``encode``; raises ImpossibleTrajectoryError naming the first step that cannot be."""
        steps = self.horizon + 1
        rows_and_columns = _whole_numbers(
            "states", states, (steps, 2 * self.n_experts), [self.height, self.width] * self.n_experts
        )
        moves = _whole_numbers("actions", actions, (steps, self.n_experts), [N_MOVES] * self.n_experts)
        cells = rows_and_columns[:, 0::2] * self.width + rows_and_columns[:, 1::2]
        expected = self.expert_successor[np.arange(self.n_experts), cells, moves]
        self._check_transitions(cells, moves, expected)
        joint_actions = np.ravel_multi_index(tuple(moves.T), (N_MOVES,) * self.n_experts)
        return Trajectories(self.joint_state(cells.T)[None], joint_actions[None])

    def _check_transitions(self, cells: Indices, moves: Indices, expected: Indices) -> None:
        wrong = np.argwhere(cells[1:] != expected[:-1])
        if len(wrong):
            step, expert = wrong[0]
            here, there, should = (
                tuple(int(x) for x in np.divmod(cell, self.width))
                for cell in (cells[step, expert], cells[step + 1, expert], expected[step, expert])
            )
            raise ImpossibleTrajectoryError(
                f"step {step}: expert {expert + 1} moves {MOVE_NAMES[moves[step, expert]]} from {here} and is then"
                f" at {there}; the game allows only {should}"
            )


def _whole_numbers(what: str, values: Array, shape: tuple[int, int], bounds: list[int]) -> Indices:
    """``values`` as integers with 0 <= values[:, k] < bounds[k]; raises ImpossibleTrajectoryError otherwise."""
    if values.shape != shape:
        raise ImpossibleTrajectoryError(f"{what}: shape {values.shape}, expected {shape}")
    fits = (values >= 0) & (values < bounds) & (values == np.floor(values))
    if not fits.all():
        step, column = np.argwhere(~fits)[0]
        raise ImpossibleTrajectoryError(
            f"{what} at step {step}, column {column}: {values[step, column]}, expected a whole number from 0"
            f" to {bounds[column] - 1}"
        )
    return values.astype(np.int64)
