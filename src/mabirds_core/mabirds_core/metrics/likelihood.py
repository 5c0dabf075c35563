"""How probable demonstrations are under a policy, in nats per demonstration.

    log p(zeta | pi) = sum_{t : s_t is not the goal} log pi_t(a_t | s_t)

Steps after the last arrival do not count: whatever is done there leads nowhere. A demonstration is held out where it
had no part in learning the policy; the newest one is, before it is learned.
"""

from collections.abc import Callable

import numpy as np

from mabirds_core.arrays import Indices, Vector
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
    whose, steps = np.nonzero(~game.goal[states])
    chances = _log_chances(policy, steps, states[whose, steps], actions[whose, steps])
    return np.bincount(whose, chances, minlength=len(states)).astype(np.float64)


def _log_chances(policy: TabularPolicy, steps: Indices, states: Indices, actions: Indices) -> Vector:
    """log pi_t(a | s) of single actions; at once where the policy can."""
    at_once: Callable[..., Vector] | None = getattr(policy, "log_chances", None)
    if at_once is not None:
        return at_once(steps, states, actions)
    chances = np.empty(len(steps))
    for step in np.unique(steps):
        now = np.flatnonzero(steps == step)
        chances[now] = policy.log_probabilities(int(step), states[now])[np.arange(len(now)), actions[now]]
    return chances
