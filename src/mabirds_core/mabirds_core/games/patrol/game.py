"""The evader-patroller game (paper, section 5.1): experts walk on a grid map to their goals.

Each expert moves north, east, south or west; a move off the map stays in place; at its own goal an expert
stays for ever. Obstacle cells can be entered, which is what experts may not do. Two experts may neither share
a cell nor swap cells. Cells are (row, column), row 0 at the top.
"""

from dataclasses import asdict
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Indices, Mask, Vector, weighted_counts
from mabirds_core.digest import trajectory_digest
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.factored import Factors
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.arrival import ArrivingReward, lateness
from mabirds_core.games.patrol.features import PatrolCostFeatures, PatrolRewardFeatures
from mabirds_core.games.patrol.geometry import MOVE_NAMES, N_MOVES, PatrolGrid
from mabirds_core.games.patrol.neutral import ExpertMoves
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.games.tabular.decoding import whole_numbers
from mabirds_core.games.tabular.game import EnumerableGame


class PatrolGame(EnumerableGame):
    """A tabular game: n cells, S = n^N_E joint states, A = 4^N_E joint actions.

    A joint state is the mixed-radix number of the experts' cells (expert 1 most significant), a cell the index
    row * width + column; joint actions likewise.

    Parameters
    ----------
    settings : PatrolSettings
        Of the game.
    """

    def __init__(self, settings: PatrolSettings) -> None:
        self.settings = settings
        self.grid = grid = PatrolGrid(len(settings.rows), len(settings.rows[0]), settings.goals)
        self.height, self.width, self.n_cells = grid.height, grid.width, grid.n_cells
        self.n_experts, self.n_states, self.n_actions = grid.n_experts, grid.n_states, grid.n_actions
        self.cell_index, self.cells, self.moves = grid.cell_index, grid.cells, grid.moves
        self.joint_state, self.goals = grid.joint_state, grid.goals
        self.horizon, self.discount = settings.horizon, settings.discount
        self.deadline = settings.horizon if settings.deadline is None else settings.deadline
        self.obstacles: Mask = np.array([cell == "#" for row in settings.rows for cell in row])

    @cached_property
    def digest(self) -> str:
        """Digest of the map's size, the absorbing goals and the horizon: obstacles can be entered, and bind nobody."""
        return trajectory_digest("patrol", asdict(self.grid), self.horizon)

    @property
    def expert_successor(self) -> Indices:
        """expert_successor[i, c, a]: where move a takes expert i from cell c, shape (N_E, n, 4)."""
        return self.grid.expert_successor

    @property
    def successor(self) -> Indices:
        """successor[s, a], shape (S, A)."""
        return self.grid.successor

    @property
    def factors(self) -> Factors:
        """How it factorises."""
        return self.grid.factors

    @property
    def sharing(self) -> Indices:
        """sharing[s]: pairs of experts in one cell, shape (S,)."""
        return self.grid.sharing

    @property
    def swapping(self) -> NDArray[np.int8]:
        """swapping[s, a]: pairs of experts that exchange their cells, shape (S, A)."""
        return self.grid.swapping

    @cached_property
    def cost_features(self) -> PatrolCostFeatures:
        """phi: an indicator per cell and expert, pairs sharing, pairs swapping."""
        return PatrolCostFeatures(self.grid, self.settings.joint_scale)

    @cached_property
    def reward_features(self) -> PatrolRewardFeatures:
        """An indicator per expert, cell and move."""
        return PatrolRewardFeatures(self.grid)

    def arriving_reward(self) -> ArrivingReward:
        """theta^T of the moves' indicators, and of being late."""
        late = lateness(self.grid, self.goals, self.discount, self.horizon)
        return ArrivingReward(self.reward_features, late)

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
        """-step_cost per step for each expert that has not arrived, shape (S, A)."""
        waiting = (~self._arrived).sum(axis=0)
        return np.repeat(-self.settings.step_cost * waiting[:, None], self.n_actions, axis=1)

    @cached_property
    def initial_distribution(self) -> Vector:
        """P_0 over joint states."""
        starts = [[self.cell_index(cell) for cell in start] for start in self.settings.starts]
        states = self.joint_state(np.array(starts).T)
        weights = self.settings.start_probabilities or [1 / len(starts)] * len(starts)
        return weighted_counts(states, np.asarray(weights) / sum(weights), self.n_states)

    def neutral_change(self, rewards: Vector, omega: Vector, expected: Vector, feature: int) -> Parameters | None:
        """A cell that ordinary moves lead into and out of (``neutral``); sharing and swapping that cost nothing."""
        costs, n = np.zeros_like(omega), self.n_cells
        expert, cell = divmod(feature, n)
        if expert == self.n_experts:  # sharing or swapping, which no reward feature speaks of
            costs[feature] = -omega[feature]
            return Parameters(np.zeros_like(rewards), costs)
        by_expert = rewards.reshape(self.n_experts, n, N_MOVES)
        moves = ExpertMoves(
            self.expert_successor[expert],
            int(self.goals[expert]),
            by_expert[expert] + omega[expert * n : (expert + 1) * n, None],
            expected.reshape(by_expert.shape)[expert],
            self.discount,
        )
        change = moves.neutral_change(cell)
        if change is None:
            return None
        changes = np.zeros_like(by_expert)
        changes[expert] = change
        return Parameters(changes.ravel(), costs)

    def encode(self, trajectory: Trajectories) -> tuple[Array, Array]:
        """States as row and column of each expert (T + 1, 2 N_E), actions as each expert's move (T + 1, N_E)."""
        cells = self.cells(trajectory.states[0])
        positions = np.stack(np.divmod(cells, self.width), axis=1)
        states = positions.reshape(2 * self.n_experts, -1).T
        return states.astype(np.float64), self.moves(trajectory.actions[0]).T.astype(np.float64)

    def decode(self, states: Array, actions: Array) -> Trajectories:
        """Inverse of ``encode``.

        Raises
        ------
        ImpossibleTrajectoryError
            The message names the first step that cannot be.
        """
        steps = self.horizon + 1
        rows_and_columns = whole_numbers(
            "states", states, (steps, 2 * self.n_experts), [self.height, self.width] * self.n_experts
        )
        moves = whole_numbers("actions", actions, (steps, self.n_experts), [N_MOVES] * self.n_experts)
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
