"""How well a learner imitates, and how far learners are apart.

- CVR, constraint violation rate: probability that a trajectory breaks a true constraint at some step.
- SR, success rate: probability that no true constraint is broken and every expert is at its goal at step T.
"""

from collections.abc import Sequence

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import TabularGame, Trajectories
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.planners.interface import TabularPolicy
from mabirds_core.planners.occupancy import occupancy_measure


def exact_imitation(game: TabularGame, policy: TabularPolicy) -> ImitationMetrics:
    """CVR and SR without sampling: the probability mass that stays clean is followed through time.

    Parameters
    ----------
    game : TabularGame
        With its true constraints.
    policy : TabularPolicy
        What is judged.

    Returns
    -------
    ImitationMetrics
        Exact.
    """
    clean = game.initial_distribution
    for step in range(game.horizon + 1):
        states = np.flatnonzero(clean)
        pairs = clean[states, None] * np.exp(policy.log_probabilities(step, states))
        pairs[game.violation[states]] = 0.0
        clean = game.transitions.onward(pairs, states)
    # Rounding may carry a probability past 1 by some 1e-15.
    return ImitationMetrics(max(0.0, 1.0 - float(pairs.sum())), min(1.0, float(pairs[game.goal[states]].sum())))


def sampled_imitation(game: TabularGame, trajectories: Trajectories) -> ImitationMetrics:
    """CVR and SR as shares of the given trajectories.

    Parameters
    ----------
    game : TabularGame
        With its true constraints.
    trajectories : Trajectories
        m rollouts of a policy.

    Returns
    -------
    ImitationMetrics
        Multiples of 1/m.
    """
    violated = game.violation[trajectories.states, trajectories.actions].any(axis=1)
    arrived = game.goal[trajectories.states[:, -1]]
    return ImitationMetrics(float(violated.mean()), float((arrived & ~violated).mean()))


def consensus_distance(vectors: Sequence[Vector]) -> float:
    """max_v || x_v - mean x ||_2 over the learners' vectors."""
    stacked = np.stack(vectors)
    return float(np.sqrt(((stacked - stacked.mean(axis=0)) ** 2).sum(axis=1)).max())


def policy_distance(game: TabularGame, policies: Sequence[TabularPolicy]) -> float:
    """Largest total variation distance between two policies' occupancy measures.

    Parameters
    ----------
    game : TabularGame
        Where they act.
    policies : Sequence[TabularPolicy]
        Of which each two are compared.

    Returns
    -------
    float
        In [0, 1]; 0 for a single policy.
    """
    return largest_distance([occupancy_measure(game, policy) for policy in policies])


def largest_distance(occupancies: Sequence[Array]) -> float:
    """Largest total variation distance between two of them, in [0, 1]; 0 for a single one."""
    return max(
        (float(np.abs(a - b).sum() / 2) for i, a in enumerate(occupancies) for b in occupancies[:i]), default=0.0
    )


def norms(parameters: Parameters) -> dict[str, float]:
    """Euclidean norms of theta and omega, by name."""
    return {f"{name}_norm": float(np.sqrt((values**2).sum())) for name, values in parameters._asdict().items()}
