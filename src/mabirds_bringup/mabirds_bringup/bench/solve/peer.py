"""The same policy and expectations by the ``imitation`` package's tabular MCE-IRL, with dense transitions.

Its rewards are of states alone, and so are those that it is compared with: weights of cells, and of sharing one.
"""

from collections.abc import Callable
from importlib import import_module
from importlib.util import find_spec
from types import SimpleNamespace

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.factored import FactoredGame
from mabirds_core.games.interface import Visitation
from mabirds_core.planners.occupancy import pairs_of

Solved = tuple[Vector, Vector]
"""Expected totals of reward features and of cost features."""


def of_states(game: FactoredGame, theta: Vector, omega: Vector) -> tuple[Vector, Vector]:
    """Weights that look at states alone.

    Parameters
    ----------
    game : FactoredGame
        With the moves.
    theta : Vector
        Of experts, cells and moves.
    omega : Vector
        Of cells, sharing and swapping.

    Returns
    -------
    tuple[Vector, Vector]
        With the first move's weight for all moves, and none for swapping.
    """
    n_moves = game.factors.n_moves
    by_cell = np.repeat(theta.reshape(-1, n_moves)[:, :1], n_moves, axis=1)
    return by_cell.ravel(), np.append(omega[:-1], 0.0)


def peer_solve(game: FactoredGame, theta: Vector, omega: Vector) -> Callable[[], Solved] | None:
    """Prepare the dense game, which is not part of what is timed.

    Parameters
    ----------
    game : FactoredGame
        S^2 A transitions must fit into memory.
    theta : Vector
        As ``of_states`` gives it.
    omega : Vector
        As ``of_states`` gives it.

    Returns
    -------
    Callable[[], tuple[Vector, Vector]] or None
        Solves it and sums up features; None where ``imitation`` is not installed.
    """
    if find_spec("imitation") is None:
        return None
    mce = import_module("imitation.algorithms.mce_irl")
    table = game.reward_features.table(theta) + game.cost_features.table(omega)
    environment = SimpleNamespace(
        horizon=game.horizon + 1,
        state_dim=game.n_states,
        action_dim=game.n_actions,
        transition_matrix=_dense(game),
        initial_state_dist=game.initial_distribution,
        reward_matrix=table[:, 0],
    )

    def solved() -> Solved:
        _, _, policy = mce.mce_partition_fh(environment, discount=game.discount)
        present, _ = mce.mce_occupancy_measures(environment, pi=policy, discount=game.discount)
        visitation = _visitation(game, present[:-1], policy)
        return game.reward_features.total(visitation), game.cost_features.total(visitation)

    return solved


def _dense(game: FactoredGame) -> Array:
    """P[s, a, s']."""
    dense = np.zeros((game.n_states, game.n_actions, game.n_states))
    states, actions = np.indices(game.successor.shape)
    dense[states, actions, game.successor] = 1.0
    return dense


def _visitation(game: FactoredGame, present: Array, policy: Array) -> Visitation:
    discounts = game.discount ** np.arange(game.horizon + 1)
    return pairs_of(np.einsum("t,ts,tsa->sa", discounts, present, policy))
