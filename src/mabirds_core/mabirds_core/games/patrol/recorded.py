"""Recorded places as patrols: a grid over the area, and the moves that follow what was recorded from cell to cell.

A cell is as wide as the way that the fastest agent goes in a step, so that nobody skips one. At every step each expert
makes the move, or waits, whose cell is nearest to the place recorded one step later; how far it is from there is told,
and whoever imports decides what is too much. Row 0 is the one with the largest y.
"""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from mabirds_core.arrays import Array, Indices
from mabirds_core.errors import ExperimentError
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.recordings import Fit, Goal, Observed

if TYPE_CHECKING:
    from mabirds_core.games.patrol.game import PatrolGame

MOVING = 1e-9
"""Squared metres by which waiting is nearer than a move that leads nowhere else."""


def observed_settings(observed: Observed) -> dict[str, Any]:
    """Settings of a patrol game over the area in which agents were seen.

    Parameters
    ----------
    observed : Observed
        Of the agents.

    Returns
    -------
    dict[str, Any]
        Parts of an experiment file: the game, the demonstrations.

    Raises
    ------
    ExperimentError
        All episodes begin with two agents in one cell.
    """
    side = round(observed.max_speed * observed.time_step, 6)
    columns, rows = (max(1, math.ceil(length / side - 1e-9)) for length in observed.sides)
    starts = _joint_starts(cells_of(observed.starts, side, rows, columns), columns)
    if not starts:
        raise ExperimentError(
            f"game.kind patrol: all episodes begin with two agents in one cell of {side:g} m; make cells smaller, by a"
            " shorter steps.time_step"
        )
    centres = centres_of(np.arange(rows * columns), side, rows, columns)
    game = {
        "kind": "patrol",
        "map": "\n".join(["." * columns] * rows),
        "starts": starts,
        "goals": [_goal_cells(goal, centres, side, columns) for goal in observed.goals],
        "horizon": observed.horizon,
        "waiting": True,
        "diagonals": True,
        "leaving": True,
        "truth": "unknown",
        "cell": side,
        "time_step": observed.time_step,
    }
    return {"game": game, "demonstrations": {}}


def cells_of(places: Array, side: float, rows: int, columns: int) -> Indices:
    """The cells of places; outside the map the nearest ones.

    Parameters
    ----------
    places : Array
        Shape (..., 2) [m].
    side : float
        Of a cell [m].
    rows : int
        Of the map.
    columns : int
        Of the map.

    Returns
    -------
    Indices
        Shape (...).
    """
    column = np.clip(np.floor(places[..., 0] / side).astype(np.int64), 0, columns - 1)
    up = np.clip(np.floor(places[..., 1] / side).astype(np.int64), 0, rows - 1)
    return np.asarray((rows - 1 - up) * columns + column)


def centres_of(cells: Indices, side: float, rows: int, columns: int) -> Array:
    """The middles of cells.

    Parameters
    ----------
    cells : Indices
        Shape (...).
    side : float
        Of a cell [m].
    rows : int
        Of the map.
    columns : int
        Of the map.

    Returns
    -------
    Array
        Shape (..., 2) [m].
    """
    row, column = np.divmod(cells, columns)
    return np.stack([(column + 0.5) * side, (rows - row - 0.5) * side], axis=-1)


def _joint_starts(cells: Indices, columns: int) -> list[list[list[int]]]:
    """Each once, as row and column of each expert; without those in which two share a cell."""
    apart = [joint for joint in np.unique(cells, axis=0) if len(np.unique(joint)) == len(joint)]
    return [[[int(part) for part in divmod(int(cell), columns)] for cell in joint] for joint in apart]


def _goal_cells(goal: Goal, centres: Array, side: float, columns: int) -> list[list[int]]:
    """Cells whose middles are in the goal, or else the nearest one."""
    away = goal.distances(centres)
    cells = np.flatnonzero(away <= max(goal.radius, float(away.min()) + 1e-9 * side))
    return [[int(part) for part in divmod(int(cell), columns)] for cell in cells]


def fit_places(game: "PatrolGame", places: Array) -> Fit:
    """Follow places that were recorded.

    Parameters
    ----------
    game : PatrolGame
        Over an area.
    places : Array
        Of each expert at the steps t = 0 .. T + 1, shape (T + 2, N_E, 2) [m].

    Returns
    -------
    Fit
        One trajectory, and the middles of its cells.

    Raises
    ------
    ExperimentError
        The game has no cells in metres, or the places are not those of T + 2 steps.
    """
    side, experts = game.settings.cell, np.arange(game.n_experts)
    if side is None:
        raise ExperimentError("game.cell: recordings are imported to patrols whose cells are told in metres; set that")
    if places.shape != (game.horizon + 2, game.n_experts, 2):
        raise ExperimentError(f"places: shape {places.shape}, expected {(game.horizon + 2, game.n_experts, 2)}")
    middles = centres_of(np.arange(game.n_cells), side, game.height, game.width)
    waits = np.array([way == (0, 0) for way in game.grid.steps_of_moves.values()])
    cells = np.empty((game.horizon + 2, game.n_experts), dtype=np.int64)
    moves = np.empty((game.horizon + 1, game.n_experts), dtype=np.int64)
    cells[0] = cells_of(places[0], side, game.height, game.width)
    for step in range(game.horizon + 1):
        after = game.expert_successor[experts, cells[step]]
        away = ((middles[after] - places[step + 1][:, None]) ** 2).sum(axis=-1)
        moves[step] = (away + np.where(waits, 0.0, MOVING)).argmin(axis=1)
        cells[step + 1] = after[experts, moves[step]]
    joint = np.asarray(np.ravel_multi_index(tuple(moves.T), (game.n_moves,) * game.n_experts))
    trajectory = Trajectories(game.joint_state(cells[:-1].T)[None], joint[None])
    return Fit(trajectory, middles[cells[:-1]], game.grid.is_goal[experts, cells[:-1]])
