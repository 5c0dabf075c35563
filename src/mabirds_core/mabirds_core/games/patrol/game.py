"""The evader-patroller game (paper, section 5.1): experts walk on a grid map to their goals.

Each expert moves north, east, south or west; a move off the map stays in place; at its own goal an expert
stays for ever. Obstacle cells can be entered, which is what experts may not do. Two experts may neither share
a cell nor swap cells. Cells are (row, column), row 0 at the top. Options add waiting, diagonal moves, goals of several
cells, goals that are exits, moves that slip, and a truth that nobody knows.
"""

from collections.abc import Sequence
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Indices, Mask, Vector, weighted_counts
from mabirds_core.digest import trajectory_digest
from mabirds_core.errors import UnknownTruthError
from mabirds_core.games.factored import Factors
from mabirds_core.games.interface import Trajectories, Transitions
from mabirds_core.games.patrol.arrival import ArrivingReward, lateness
from mabirds_core.games.patrol.decoding import decoded_steps
from mabirds_core.games.patrol.features import PatrolCostFeatures, PatrolRewardFeatures
from mabirds_core.games.patrol.named_costs import named_features
from mabirds_core.games.patrol.neutral import ExpertMoves
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.games.tabular.game import EnumerableGame
from mabirds_core.games.tabular.transitions import Deterministic, Slipping
from mabirds_core.rewards.models import LinearReward

if TYPE_CHECKING:
    from mabirds_core.games.patrol.cost_inputs import PatrolCostInputs


class PatrolGame(EnumerableGame):
    """A tabular game: n cells, S = n^N_E joint states, A = M^N_E joint actions of M moves each, four by default.

    A joint state is the mixed-radix number of the experts' cells (expert 1 most significant), a cell the index
    row * width + column; joint actions likewise.

    Parameters
    ----------
    settings : PatrolSettings
        Of the game.
    """

    def __init__(self, settings: PatrolSettings) -> None:
        self.settings = settings
        self.grid = grid = settings.grid
        self.height, self.width, self.n_cells = grid.height, grid.width, grid.n_cells
        self.n_experts, self.n_states, self.n_actions = grid.n_experts, grid.n_states, grid.n_actions
        self.cell_index, self.cells, self.moves = grid.cell_index, grid.cells, grid.moves
        self.joint_state, self.n_moves = grid.joint_state, grid.n_moves
        self.horizon, self.discount = settings.horizon, settings.discount
        self.deadline = settings.horizon if settings.deadline is None else settings.deadline
        self.violation_cost = settings.violation_cost if settings.slip else np.inf
        self.obstacles: Mask = np.array([cell == "#" for row in settings.rows for cell in row])

    @cached_property
    def digest(self) -> str:
        """Digest of the map's size, moves, goals and the horizon: obstacles can be entered, and bind nobody."""
        return trajectory_digest("patrol", self.grid.dynamics, self.horizon)

    @property
    def expert_successor(self) -> Indices:
        """expert_successor[i, c, a]: where move a takes expert i from cell c, shape (N_E, n, M)."""
        return self.grid.expert_successor

    @property
    def successor(self) -> Indices:
        """successor[s, a], shape (S, A)."""
        return self.grid.successor

    @cached_property
    def transitions(self) -> Transitions:
        """Where moves lead, as chosen or slipping."""
        chosen, slip = Deterministic(lambda: self.successor), self.settings.slip
        return Slipping(chosen, self.n_experts, self.n_moves, slip) if slip else chosen

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
        """swapping[s, a]: pairs of experts that would pass through each other, shape (S, A)."""
        return self.grid.swapping

    @cached_property
    def cost_features(self) -> PatrolCostFeatures:
        """phi: an indicator per cell and expert, pairs sharing, pairs swapping, and those of the user's own."""
        return PatrolCostFeatures(self.grid, self.settings.joint_scale, self._named)

    @cached_property
    def _named(self) -> dict[str, Vector]:
        return named_features(self.grid, self.settings.costs, self.settings.layers)

    def cost_inputs(self, chosen: Sequence[str] | None) -> "PatrolCostInputs":
        """What a cost network sees of a joint state: inputs by name, or all there are."""
        from mabirds_core.games.patrol.cost_inputs import PatrolCostInputs  # networks are rare

        return PatrolCostInputs(self.grid, self.settings.layers, self._named, self.settings.joint_scale, chosen)

    @cached_property
    def reward_features(self) -> PatrolRewardFeatures:
        """An indicator per expert, cell and move."""
        return PatrolRewardFeatures(self.grid)

    def arriving_reward(self) -> ArrivingReward | LinearReward:
        """theta^T of the moves' indicators, and of being late; of who slips or leaves, moves do not say it."""
        if self.settings.slip or self.settings.leaving:
            return self.linear_reward()
        return ArrivingReward(self.reward_features, lateness(self.grid, self.discount, self.horizon))

    @property
    def expert_kinds(self) -> tuple[str, ...]:
        """Nobody can act for experts without knowing what they may do."""
        return super().expert_kinds if self.settings.truth == "map" else ()

    @cached_property
    def true_constraints(self) -> Mask | None:
        """Obstacle cells of every expert, sharing and swapping, and nothing of the user's own; shape (K,)."""
        if self.settings.truth == "unknown":
            return None
        joint = np.full(2, self.n_experts > 1)
        named = np.zeros(len(self.settings.costs), dtype=np.bool_)
        return np.concatenate([np.tile(self.obstacles, self.n_experts), joint, named])

    @cached_property
    def violation(self) -> Mask:
        """violation[s, a]: an expert on an obstacle, two in one cell, or two swapping."""
        self._require_truth("which pairs break constraints")
        on_obstacle = self.obstacles[self.cells(np.arange(self.n_states))].any(axis=0)
        of_state: Mask = on_obstacle | (self.sharing > 0)
        return of_state[:, None] | (self.swapping > 0)

    @cached_property
    def _arrived(self) -> Mask:
        cells = self.cells(np.arange(self.n_states))
        return np.stack([is_goal[own] for is_goal, own in zip(self.grid.is_goal, cells, strict=True)])

    @cached_property
    def goal(self) -> Mask:
        """goal[s]: every expert is at its goal."""
        return np.asarray(self._arrived.all(axis=0))

    @cached_property
    def task_reward(self) -> Array:
        """-step_cost per step for each expert that has not arrived, -true_cost at every step; shape (S, A)."""
        self._require_truth("the experts' own reward")
        waiting = (~self._arrived).sum(axis=0)
        of_states = -self.settings.step_cost * waiting - self.true_cost
        return np.repeat(of_states[:, None], self.n_actions, axis=1)

    @property
    def true_cost(self) -> Vector:
        """What experts really pay in joint states beside steps and constraints, shape (S,)."""
        text, settings = self.settings.true_cost, self.settings
        if text is None:
            return np.zeros(self.n_states)
        return named_features(self.grid, {"true_cost": text}, settings.layers)["true_cost"]

    def _require_truth(self, what: str) -> None:
        if self.settings.truth == "unknown":
            raise UnknownTruthError(f"{what}: nobody knows where game.truth is unknown; give the map's obstacles")

    @cached_property
    def initial_distribution(self) -> Vector:
        """P_0 over joint states."""
        starts = [[self.cell_index(cell) for cell in start] for start in self.settings.starts]
        states = self.joint_state(np.array(starts).T)
        weights = self.settings.start_probabilities or [1 / len(starts)] * len(starts)
        return weighted_counts(states, np.asarray(weights) / sum(weights), self.n_states)

    def neutral_change(self, rewards: Vector, omega: Vector, expected: Vector, feature: int) -> Parameters | None:
        """A cell that ordinary moves lead into and out of (``neutral``); sharing and all that follows costs nothing."""
        costs, n = np.zeros_like(omega), self.n_cells
        expert, cell = divmod(feature, n)
        if feature >= self.n_experts * n:  # of joint states or actions, which no reward feature speaks of
            costs[feature] = -omega[feature]
            return Parameters(np.zeros_like(rewards), costs)
        by_expert = rewards.reshape(self.n_experts, n, self.n_moves)
        moves = ExpertMoves(
            self.expert_successor[expert],
            self.grid.is_goal[expert],
            by_expert[expert] + omega[expert * n : (expert + 1) * n, None],
            expected.reshape(by_expert.shape)[expert],
            self.discount,
            self.grid.slip,
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
        """Inverse of ``encode``. Where goals are exits, steps after the last one has left may be missing.

        Raises
        ------
        ImpossibleTrajectoryError
            The message names the first step that cannot be.
        """
        return decoded_steps(self.grid, self.horizon, states, actions)
