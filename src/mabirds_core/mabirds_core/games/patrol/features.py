"""Cost and reward features of the patrol game, summed and tabulated without a matrix of all pairs."""

from collections.abc import Mapping, Sequence
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Vector, weighted_counts
from mabirds_core.games.factored import FactoredReward
from mabirds_core.games.interface import Visitation
from mabirds_core.games.patrol.geometry import PatrolGrid
from mabirds_core.kernels.factored import Totals
from mabirds_core.planners.factored import FactoredVisitation


class PatrolCostFeatures:
    """phi(s, a): indicators by expert and cell (s), pairs sharing a cell (s), pairs swapping cells (s, a), named ones.

    K = N_E n + 2 + J; expert by expert, cell by cell, then sharing, then swapping, then J of the user's own (s).
    Sharing and swapping count ``joint_scale`` times: experts meet seldom before they have learned to walk, and a larger
    feature learns faster.
    """

    def __init__(self, grid: PatrolGrid, joint_scale: float, named: Mapping[str, Vector] | None = None) -> None:
        self._grid, self._joint_scale = grid, joint_scale
        self._n_own, self._named = grid.n_experts * grid.n_cells, [*(named or {}).values()]
        self._pairs = np.arange(grid.n_pairs + 1.0)
        self.nonnegative = all(bool((values >= 0).all()) for values in self._named)
        cells = [divmod(cell, grid.width) for cell in range(grid.n_cells)]
        self.names = (
            *(f"expert_{i + 1} in ({r}, {c})" for i in range(grid.n_experts) for r, c in cells),
            "sharing a cell",
            "swapping cells",
            *(named or {}),
        )

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] phi(states[k], actions[k]), shape (K,)."""
        if isinstance(visitation, FactoredVisitation):
            return self._of_totals(visitation.totals)
        grid, (states, actions, weights) = self._grid, visitation
        cells = grid.cells(states)
        own = cells + grid.first_cells
        by_cell = weighted_counts(own, weights * grid.present.ravel()[own], self._n_own)
        sharing = (weights * grid.sharing[states]).sum()
        swapping = (weights * grid.swapping_of(cells, grid.moves(actions))).sum()
        return self._joined(by_cell, sharing, swapping, [(weights * values[states]).sum() for values in self._named])

    def _of_totals(self, totals: Totals) -> Vector:
        sharing = (totals.states * self._grid.sharing).sum()
        swapping = (totals.levels * self._pairs).sum()
        named = [(totals.states * values).sum() for values in self._named]
        return self._joined((totals.moves.sum(axis=2) * self._grid.present).ravel(), sharing, swapping, named)

    def _joined(self, by_cell: Vector, sharing: float, swapping: float, named: Sequence[float]) -> Vector:
        total = np.empty(len(self.names))
        total[: self._n_own] = by_cell
        total[self._n_own :] = self._joint_scale * sharing, self._joint_scale * swapping, *named
        return total

    def factored(self, weights: Vector) -> FactoredReward:
        """weights^T phi(s, a), by expert."""
        grid = self._grid
        swapping = self._joint_scale * weights[self._n_own + 1]
        moves = np.repeat(self._by_cell(weights)[:, :, None], grid.n_moves, axis=2)
        return FactoredReward(moves, self._of_states(weights), swapping * self._pairs)

    def table(self, weights: Vector) -> Array:
        """weights^T phi(s, a), shape (S, A)."""
        grid = self._grid
        cells = grid.cells(np.arange(grid.n_states))
        of_state, swapping = self._of_states(weights), self._joint_scale * weights[self._n_own + 1]
        for own_weights, own_cells in zip(self._by_cell(weights), cells, strict=True):
            of_state = of_state + own_weights[own_cells]
        return np.asarray(of_state[:, None] + swapping * grid.swapping)

    def _of_states(self, weights: Vector) -> Vector:
        """What sharing and the named features weigh in joint states, shape (S,)."""
        of_state: Vector = self._joint_scale * weights[self._n_own] * self._grid.sharing
        for weight, values in zip(weights[self._n_own + 2 :], self._named, strict=True):
            of_state = of_state + weight * values
        return of_state

    def _by_cell(self, weights: Vector) -> Array:
        """What a cell weighs for an expert who is there, shape (N_E, n)."""
        return np.asarray(weights[: self._n_own].reshape(self._grid.present.shape) * self._grid.present)


class PatrolRewardFeatures:
    """One indicator per expert, cell and move: K = M n N_E, moves varying fastest. Who has left makes no moves."""

    nonnegative = True

    def __init__(self, grid: PatrolGrid) -> None:
        self._grid = grid
        self.names = tuple(
            f"expert_{i + 1} in {divmod(cell, grid.width)} going {move}"
            for i in range(grid.n_experts)
            for cell in range(grid.n_cells)
            for move in grid.move_names
        )

    @cached_property
    def descriptors(self) -> Array:
        """Which expert and which move (one of 1, the others 0), then row and column from -1 to 1: D = N_E + M + 2."""
        grid = self._grid
        experts, cells, moves = np.indices((grid.n_experts, grid.n_cells, grid.n_moves)).reshape(3, -1)
        rows, columns = np.divmod(cells, grid.width)
        place = [2 * rows / max(1, grid.height - 1) - 1, 2 * columns / max(1, grid.width - 1) - 1]
        return np.column_stack([np.eye(grid.n_experts)[experts], np.eye(grid.n_moves)[moves], *place])

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] of the pairs in which an expert makes a move in a cell, shape (K,)."""
        if isinstance(visitation, FactoredVisitation):
            return (visitation.totals.moves * self._grid.present[:, :, None]).ravel()
        grid, (states, actions, weights) = self._grid, visitation
        own = grid.cells(states) + grid.first_cells
        pairs = own * grid.n_moves + grid.moves(actions)
        return weighted_counts(pairs, weights * grid.present.ravel()[own], len(self.names))

    def factored(self, weights: Vector) -> FactoredReward:
        """Sum of the experts' weights, by expert."""
        grid = self._grid
        return FactoredReward(self._by_move(weights), np.zeros(grid.n_states), np.zeros(grid.n_pairs + 1))

    def table(self, weights: Vector) -> Array:
        """Sum of the experts' weights at every joint (s, a), shape (S, A)."""
        grid = self._grid
        cells, moves = grid.cells(np.arange(grid.n_states)), grid.moves(np.arange(grid.n_actions))
        table = np.zeros((grid.n_states, grid.n_actions))
        for own_weights, own_cells, own_moves in zip(self._by_move(weights), cells, moves, strict=True):
            table += own_weights[own_cells[:, None], own_moves]
        return table

    def _by_move(self, weights: Vector) -> Array:
        """What a move weighs for an expert who is there, shape (N_E, n, M)."""
        here = self._grid.present[:, :, None]
        return np.asarray(weights.reshape(*here.shape[:2], self._grid.n_moves) * here)
