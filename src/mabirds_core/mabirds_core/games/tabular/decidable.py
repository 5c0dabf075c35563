"""Which constraints demonstrations can decide at all.

Experts without constraint k, all else equal, would touch it with probability q_k. Where (1 - q_k)^N is not small, N
demonstrations that never touch it say nothing: nobody could tell whether it is forbidden or of no use.
"""

import numpy as np

from mabirds_core.arrays import Mask, Vector
from mabirds_core.games.interface import TabularGame
from mabirds_core.games.truth import known_constraints
from mabirds_core.planners.interface import TabularPolicy
from mabirds_core.planners.soft_bellman import maximum_entropy_policy


def touch_without(game: TabularGame) -> Vector:
    """q_k: probability that soft experts, who are free of constraint k, touch it.

    Parameters
    ----------
    game : TabularGame
        With its true constraints, deadline and task reward.

    Returns
    -------
    Vector
        Shape (K,); 0 for features that are no constraints. Exact.
    """
    constraints = known_constraints(game)
    chances = np.zeros(len(constraints))
    for feature in np.flatnonzero(constraints):
        others = constraints.astype(np.float64)
        others[feature] = 0.0
        unit = np.zeros_like(others)
        unit[feature] = 1.0
        policy = maximum_entropy_policy(game, game.cost_features.table(others) > 0)
        chances[feature] = touch_chance(game, policy, game.cost_features.table(unit) > 0)
    return chances


def touch_chance(game: TabularGame, policy: TabularPolicy, touched: Mask) -> float:
    """Probability that a trajectory of a policy has one of some pairs.

    Parameters
    ----------
    game : TabularGame
        Trajectories begin in P_0.
    policy : TabularPolicy
        pi_t(a | s).
    touched : Mask
        The pairs, shape (S, A).

    Returns
    -------
    float
        In [0, 1].
    """
    clean = game.initial_distribution
    for step in range(game.horizon + 1):
        states = np.flatnonzero(clean)
        pairs = clean[states, None] * np.exp(policy.log_probabilities(step, states))
        pairs[touched[states]] = 0.0
        clean = game.transitions.onward(pairs, states)
    return min(1.0, max(0.0, 1.0 - float(clean.sum())))
