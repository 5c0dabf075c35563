"""Where patrollers spend their time."""

import numpy as np

from mabirds_core.arrays import Array, weighted_counts
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.interface import TabularPolicy


def visits(game: PatrolGame, policy: TabularPolicy) -> Array:
    """Discounted visitation of each expert's cells.

    Parameters
    ----------
    game : PatrolGame
        With the cells.
    policy : TabularPolicy
        pi_t(a | s).

    Returns
    -------
    Array
        Shape (N_E, n), each row of sum 1.
    """
    of_state = game.judge.occupancy(policy).sum(axis=1)
    cells = game.cells(np.arange(game.n_states))
    return np.stack([weighted_counts(cells_of_expert, of_state, game.n_cells) for cells_of_expert in cells])
