"""The part of an update that needs nobody else: made while what neighbours send is under way."""

import logging
import math
from typing import NamedTuple

from mabirds_core.algorithm.learner import Learner, LearnerState, LocalGradient
from mabirds_core.games.interface import Trajectories
from mabirds_core.metrics.metrics import norms
from mabirds_core.planners.interface import Policy

LIKELIHOOD = "held_out_log_likelihood"
"""Name of the metric, in nats, of the demonstration that an update is about to learn from."""

CERTIFICATE = "certificate"
"""Name of the metric, in nats, that says by how much the planner missed its own problem."""

GAP = "gap"
"""Name of the metric, in nats, that says how far a searched policy is from the one that was looked for."""

MOST_NATS = 0.1
"""Of a certificate; beyond that the problem is not solved."""


class Preparation(NamedTuple):
    """Steps 1 to 3 of an update, and what they showed.

    Attributes
    ----------
    state : LearnerState
        Before the update.
    local : LocalGradient
        At theta(n), omega(n).
    metrics : dict[str, float]
        Norms of the gradient, and how well the policy does, by name.
    """

    state: LearnerState
    local: LocalGradient
    metrics: dict[str, float]


def prepare(learner: Learner, state: LearnerState, demonstration: Trajectories) -> Preparation:
    """Make steps 1 to 3 of update n.

    Parameters
    ----------
    learner : Learner
        Who learns.
    state : LearnerState
        Before the update.
    demonstration : Trajectories
        zeta(n).

    Returns
    -------
    Preparation
        Of this state alone.
    """
    local = learner.local_gradient(state, demonstration)
    estimate = local.estimate
    metrics = {f"gradient_{name}": value for name, value in norms(estimate.gradient).items()}
    metrics |= _likelihood(learner, estimate.policy, demonstration)
    metrics |= _certificate(learner, estimate.policy, state.iteration)
    metrics |= _gap(learner, estimate.policy)
    return Preparation(state, local, metrics)


def _likelihood(learner: Learner, policy: Policy, demonstration: Trajectories) -> dict[str, float]:
    """log p(zeta(n)) under the policy of iteration n, which had not seen it; nothing where the game cannot say."""
    judge = getattr(learner.game, "judge", None)
    nats = None if judge is None else judge.log_likelihoods(policy, demonstration)
    mean = math.inf if nats is None else float(nats.mean())
    return {LIKELIHOOD: mean} if math.isfinite(mean) else {}


def _certificate(learner: Learner, policy: Policy, iteration: int) -> dict[str, float]:
    """By how much the planner's value is missed by its own policy [nats]; nothing where the game has none."""
    judge = getattr(learner.game, "judge", None)
    nats = None if judge is None else judge.certificate(policy, learner.seed)
    if nats is not None and nats > MOST_NATS:
        logging.getLogger(__name__).warning(
            "iteration %d: the planner's value is %.3g nats from what its policy earns, expected at most %g: costs"
            " or rewards are too large for it; take a higher algorithm.policy.temperature",
            *(iteration, nats, MOST_NATS),
        )
    return {} if nats is None else {CERTIFICATE: nats}


def _gap(learner: Learner, policy: Policy) -> dict[str, float]:
    """By how much what the policy earns lies below what it should [nats]; nothing of planners that are exact."""
    gap = getattr(policy, "gap", None)
    nats = None if gap is None else gap(learner.seed)
    return {} if nats is None else {GAP: float(nats)}
