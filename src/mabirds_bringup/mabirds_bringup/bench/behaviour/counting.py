"""The rule that learns nothing: what was never shown is forbidden, the surer the more often a way passed beside it.

    confidence_k = 1 - (1 - 1/m)^c_k

with c_k the number of steps from which feature k could have been had next, each expert choosing one of its m moves.
"""

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.games.interface import TabularGame, Trajectories, shown_features

COUNTED_AT = 0.95
"""Confidence from which on the rule forbids."""


def counting_scores(game: TabularGame, demonstrations: Trajectories) -> Vector:
    """Confidence of the counting rule.

    Parameters
    ----------
    game : TabularGame
        With S joint states and A = m^N_E joint actions.
    demonstrations : Trajectories
        A learner's own.

    Returns
    -------
    Vector
        Shape (K,): 0 for what was shown.
    """
    moves = game.n_actions ** (1 / game.n_experts)
    used = shown_features(game, demonstrations).used
    under_way = ~game.goal[demonstrations.states]
    states, counts = np.unique(demonstrations.states[under_way], return_counts=True)
    chances = np.zeros(len(used))
    for feature in np.flatnonzero(~used):
        unit = np.zeros(len(used))
        unit[feature] = 1.0
        touched = game.cost_features.table(unit) > 0
        next_to = (touched[game.successor[states]].all(axis=-1) | touched[states]).any(axis=1)
        chances[feature] = counts[next_to].sum()
    return np.where(used, 0.0, 1 - (1 - 1 / moves) ** chances)
