"""How probable demonstrations are under a policy, in nats per demonstration.

    log p(zeta | pi) = sum_{t : s_t is not the goal} log pi_t(a_t | s_t)

Steps after the last arrival do not count: whatever is done there leads nowhere. A demonstration is held out where it
had no part in learning the policy; the newest one is, before it is learned.
"""

from collections.abc import Callable

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
    at_once: Callable[[Trajectories], Vector] | None = getattr(policy, "log_likelihoods", None)
    return at_once(demonstrations) if at_once else _step_by_step(game, policy, demonstrations)


def _step_by_step(game: TabularGame, policy: TabularPolicy, demonstrations: Trajectories) -> Vector:
    states, actions = demonstrations
    whose, steps = np.nonzero(~game.goal[states])
    chances = np.empty(len(steps))
    for step in np.unique(steps):
        now = np.flatnonzero(steps == step)
        there, taken = states[whose[now], step], actions[whose[now], step]
        chances[now] = policy.log_probabilities(int(step), there)[np.arange(len(now)), taken]
    return np.bincount(whose, chances, minlength=len(states)).astype(np.float64)
