"""The optimum of the pooled loss, by L-BFGS: what learning from all demonstrations at once comes to.

    L(x) = E_{s_0 ~ demonstrations} V_0(s_0; x) - x^T (mean discounted feature counts),     x = (theta, omega)

is the negative discounted log likelihood, - mean sum_t gamma^t log pi_t(a_t | s_t), convex in x; scipy's L-BFGS has no
part in MA-BIRDS.
"""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.games.interface import TabularGame, Trajectories, Visitation, discounted_visitation
from mabirds_core.metrics.likelihood import log_likelihoods
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, pairs_of
from mabirds_core.planners.soft_bellman import SoftBellmanPolicy, soft_bellman_policy

MAX_EVALUATIONS = 80
"""Of the loss; held-out likelihood is best long before."""


class Optimum(NamedTuple):
    """Held-out log likelihood [nats per demonstration].

    Attributes
    ----------
    final : float
        At the end.
    best : float
        The best on the way: of early stopping.
    stopped : Vector
        x there.
    """

    final: float
    best: float
    stopped: Vector


def pooled_loss(game: TabularGame, demonstrations: Trajectories) -> Callable[[Vector], tuple[float, Vector]]:
    """L and its gradient, the expected less the demonstrated discounted feature counts, as a function of x."""
    observed = _counts(game, discounted_visitation(demonstrations, game.discount))
    starts = demonstrations.states[:, 0]

    def loss(x: Vector) -> tuple[float, Vector]:
        policy = policy_of(game, x)
        occupancy = discounted_steps(game) * occupancy_measure(game, policy, starts)
        expected = _counts(game, pairs_of(occupancy))
        return float(policy.values[0][starts].mean() - x @ observed), expected - observed

    return loss


def pooled_optimum(game: TabularGame, demonstrations: Trajectories, held_out: Trajectories) -> Optimum:
    """Minimise the pooled loss from zero; the likelihood of ``held_out`` is taken there and after every iteration."""

    def likelihood(x: Vector) -> float:
        return float(log_likelihoods(game, policy_of(game, x), held_out).mean())

    zero = np.zeros(len(game.reward_features.names) + len(game.cost_features.names))
    way = [(likelihood(zero), zero)]

    def on_iteration(x: Vector) -> None:
        if (found := likelihood(x)) > way[-1][0]:
            way.append((found, x.copy()))

    solver: Any = minimize  # scipy's types know no arrays of any shape
    end = solver(
        pooled_loss(game, demonstrations),
        zero,
        jac=True,
        method="L-BFGS-B",
        callback=on_iteration,
        options={"maxfun": MAX_EVALUATIONS, "maxiter": MAX_EVALUATIONS},
    )
    return Optimum(likelihood(end.x), *way[-1])


def policy_of(game: TabularGame, x: Vector) -> SoftBellmanPolicy:
    """The soft Bellman policy of linear theta and omega, one after the other in ``x``."""
    size = len(game.reward_features.names)
    theta, omega = Parameters(x[:size], x[size:])
    return soft_bellman_policy(game, game.reward_features.table(theta) + game.cost_features.table(omega))


def _counts(game: TabularGame, visitation: Visitation) -> Vector:
    return np.concatenate([game.reward_features.total(visitation), game.cost_features.total(visitation)])
