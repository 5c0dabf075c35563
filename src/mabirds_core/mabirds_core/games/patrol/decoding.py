"""Reading patrols from messages and bags, refusing what the game does not allow."""

import numpy as np

from mabirds_core.arrays import Array, Indices
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.geometry import PatrolGrid
from mabirds_core.games.tabular.decoding import whole_numbers


def decoded_steps(grid: PatrolGrid, horizon: int, states: Array, actions: Array) -> Trajectories:
    """Read one trajectory.

    Parameters
    ----------
    grid : PatrolGrid
        Where experts can go.
    horizon : int
        T.
    states : Array
        Row and column of each expert, shape (T + 1, 2 N_E); fewer rows where goals are exits and all have left.
    actions : Array
        Each expert's move, shape (T + 1, N_E), or as few rows.

    Returns
    -------
    Trajectories
        One, of T + 1 steps: who has left stays away.

    Raises
    ------
    ImpossibleTrajectoryError
        The message names the first step that cannot be.
    """
    rows = len(states) if grid.leaving and states.ndim == 2 and 0 < len(states) <= horizon else horizon + 1
    bounds = [grid.height, grid.width] * grid.n_experts
    places = whole_numbers("states", states, (rows, 2 * grid.n_experts), bounds)
    moves = whole_numbers("actions", actions, (rows, grid.n_experts), [grid.n_moves] * grid.n_experts)
    cells = places[:, 0::2] * grid.width + places[:, 1::2]
    _check_transitions(grid, cells, moves)
    if rows <= horizon:
        _check_all_have_left(grid, horizon, cells)
        cells, moves = (np.pad(steps, ((0, horizon + 1 - rows), (0, 0)), mode="edge") for steps in (cells, moves))
    return Trajectories(grid.joint_state(cells.T)[None], grid.joint_action(moves.T)[None])


def _check_all_have_left(grid: PatrolGrid, horizon: int, cells: Indices) -> None:
    under_way = np.flatnonzero(~grid.is_goal[np.arange(grid.n_experts), cells[-1]])
    if len(under_way):
        expert = int(under_way[0])
        raise ImpossibleTrajectoryError(
            f"states: end at step {len(cells) - 1} with expert {expert + 1} in {_place(grid, cells[-1, expert])}, no"
            f" exit of it; expected all experts to have left, or {horizon + 1} steps"
        )


def _check_transitions(grid: PatrolGrid, cells: Indices, moves: Indices) -> None:
    experts = np.arange(grid.n_experts)
    expected = grid.expert_successor[experts, cells[:-1], moves[:-1]]
    possible = cells[1:] == expected
    if possible.all():
        return
    if grid.slip:  # any move may come of any other
        possible |= (grid.expert_successor[experts, cells[:-1]] == cells[1:, :, None]).any(axis=-1)
    wrong = np.argwhere(~possible)
    if len(wrong):
        step, expert = wrong[0]
        here, there, should = (
            _place(grid, cell) for cell in (cells[step, expert], cells[step + 1, expert], expected[step, expert])
        )
        raise ImpossibleTrajectoryError(
            f"step {step}: expert {expert + 1} moves {grid.move_names[moves[step, expert]]} from {here} and is then"
            f" at {there}; the game allows only {should}" + (" and what lies beside" if grid.slip else "")
        )


def _place(grid: PatrolGrid, cell: int) -> tuple[int, int]:
    row, column = divmod(int(cell), grid.width)
    return row, column
