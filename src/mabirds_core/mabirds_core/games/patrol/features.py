"""Cost and reward features of the patrol game, summed and tabulated without a matrix of all pairs."""

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from mabirds_core.arrays import Array, Vector, weighted_counts
from mabirds_core.games.interface import Visitation

if TYPE_CHECKING:
    from mabirds_core.games.patrol.game import PatrolGame


MOVE_NAMES = ("north", "east", "south", "west")
N_MOVES = len(MOVE_NAMES)


class PatrolCostFeatures:
    """phi(s, a): one indicator an expert and cell (s), pairs sharing a cell (s), pairs swapping cells (s, a).

    K = N_E n + 2; expert by expert, cell by cell, then sharing, then swapping. The last two count ``joint_scale``
    times: experts meet seldom before they have learned to walk, and a larger feature learns faster.
    """

    def __init__(self, game: "PatrolGame") -> None:
        self._game = game
        cells = [divmod(cell, game.width) for cell in range(game.n_cells)]
        self.names = (
            *(f"expert_{i + 1} in ({r}, {c})" for i in range(game.n_experts) for r, c in cells),
            "sharing a cell",
            "swapping cells",
        )

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] phi(states[k], actions[k]), shape (K,)."""
        game, (states, actions, weights) = self._game, visitation
        by_cell = [weighted_counts(cells, weights, game.n_cells) for cells in game.cells(states)]
        sharing = (weights * game.sharing[states]).sum()
        swapping = (weights * game.swapping[states, actions]).sum()
        return np.concatenate([*by_cell, game.settings.joint_scale * np.array([sharing, swapping])])

    def table(self, weights: Vector) -> Array:
        """weights^T phi(s, a), shape (S, A)."""
        game = self._game
        by_cell = weights[:-2].reshape(game.n_experts, game.n_cells)
        cells = game.cells(np.arange(game.n_states))
        sharing, swapping = game.settings.joint_scale * weights[-2:]
        of_state: Vector = sharing * game.sharing
        for own_weights, own_cells in zip(by_cell, cells, strict=True):
            of_state = of_state + own_weights[own_cells]
        return np.asarray(of_state[:, None] + swapping * game.swapping)


class PatrolRewardFeatures:
    """One indicator an expert, cell and move: K = 4 n N_E, moves varying fastest."""

    def __init__(self, game: "PatrolGame") -> None:
        self._game = game
        self.names = tuple(
            f"expert_{i + 1} in {divmod(cell, game.width)} going {move}"
            for i in range(game.n_experts)
            for cell in range(game.n_cells)
            for move in MOVE_NAMES
        )

    @cached_property
    def descriptors(self) -> Array:
        """Which expert and which move (one of 1, the others 0), then row and column from -1 to 1: D = N_E + 6."""
        game = self._game
        experts, cells, moves = np.indices((game.n_experts, game.n_cells, N_MOVES)).reshape(3, -1)
        rows, columns = np.divmod(cells, game.width)
        place = [2 * rows / max(1, game.height - 1) - 1, 2 * columns / max(1, game.width - 1) - 1]
        return np.column_stack([np.eye(game.n_experts)[experts], np.eye(N_MOVES)[moves], *place])

    def total(self, visitation: Visitation) -> Vector:
        """sum_k weights[k] of the pairs in which an expert makes a move in a cell, shape (K,)."""
        game, (states, actions, weights) = self._game, visitation
        pairs = game.cells(states) * N_MOVES + game.moves(actions)
        size = game.n_cells * N_MOVES
        return np.concatenate([weighted_counts(own, weights, size) for own in pairs])

    def table(self, weights: Vector) -> Array:
        """Sum of the experts' weights at every joint (s, a), shape (S, A)."""
        game = self._game
        cells, moves = game.cells(np.arange(game.n_states)), game.moves(np.arange(game.n_actions))
        table = np.zeros((game.n_states, game.n_actions))
        by_expert = weights.reshape(game.n_experts, game.n_cells, -1)
        for own_weights, own_cells, own_moves in zip(by_expert, cells, moves, strict=True):
            table += own_weights[own_cells[:, None], own_moves]
        return table
