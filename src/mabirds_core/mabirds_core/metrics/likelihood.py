"""How probable demonstrations are under a policy, in nats per demonstration.

    log p(zeta | pi) = sum_{t : s_t is not the goal} log pi_t(a_t | s_t)

Steps after the last arrival do not count: whatever is done there leads nowhere. A demonstration is held out where it
had no part in learning the policy; the newest one is, before it is learned.
"""

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.games.interface import TabularGame, Trajectories
from mabirds_core.planners.interface import TabularPolicy


def log_likelihoods(game: TabularGame, policy: TabularPolicy, demonstrations: Trajectories) -> Vector:
    """log p(zeta | pi) of each demonstration while it is under way.

    Parameters
    ----------
    game : TabularGame
        Whose goal ends the way.
    policy : TabularPolicy
        pi.
    demonstrations : Trajectories
        m of them.

    Returns
    -------
    Vector
        Natural logarithms, shape (m,); -inf where a step has no probability.
    """
    states, actions = demonstrations
    total = np.zeros(len(states))
    for step in range(game.horizon + 1):
        under_way = np.flatnonzero(~game.goal[states[:, step]])
        chances = policy.log_probabilities(step, states[under_way, step])
        total[under_way] += chances[np.arange(len(under_way)), actions[under_way, step]]
    return total
