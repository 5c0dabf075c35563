"""The inner problem alone: the optimum of the dual G(omega) at the experts' own reward, by L-BFGS.

    G(omega) = E V_0(s_0; theta, omega) - omega^T b + weight / 2 |omega|^2,    grad G = E_pi mu - b + weight omega

With b = 0 for a cost that a policy can avoid, G falls for ever as that omega does: a smaller tolerance gives a larger
omega. With b > 0, or with a weight, it does not.
"""

from typing import Any, NamedTuple

import numpy as np
from scipy.optimize import minimize

from mabirds_bringup.bench.theory.cases import TheoryCase
from mabirds_bringup.bench.theory.network import WEIGHT
from mabirds_bringup.bench.theory.problem import Problem
from mabirds_core.arrays import Vector
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, pairs_of
from mabirds_core.planners.soft_bellman import soft_bellman_policy

TOLERANCES = (1e-1, 1e-2, 1e-3, 1e-4)
"""Of the largest entry of the gradient."""

VARIANTS = {
    "b > 0": TheoryCase("inner", "soft"),
    "b = 0": TheoryCase("inner", "hard", hard=True),
    "b = 0, regularised": TheoryCase("inner", "regularised", hard=True, omega="regularised"),
}


class InnerOptimum(NamedTuple):
    """What the solver found: the largest -omega, and the largest entry of the gradient there."""

    largest_cost: float
    gradient: float


def dual(problem: Problem, omega: Vector) -> tuple[float, Vector]:
    """G and its gradient."""
    game, weight = problem.game, WEIGHT if problem.case.omega == "regularised" else 0.0
    reward = game.reward_features.table(problem.true_theta) + game.cost_features.table(omega)
    policy = soft_bellman_policy(game, reward)
    expected = game.cost_features.total(pairs_of(discounted_steps(game) * occupancy_measure(game, policy)))
    value = game.initial_distribution @ policy.values[0] - omega @ problem.budget + weight / 2 * omega @ omega
    return float(value), expected - problem.budget + weight * omega


def inner_optimum(problem: Problem, tolerance: float) -> InnerOptimum:
    """From omega = 0 until the gradient's largest entry is below ``tolerance``."""
    solver: Any = minimize  # scipy's types know no arrays of any shape
    options = {"gtol": tolerance, "ftol": 0.0, "maxiter": 2000, "maxfun": 4000}
    start = np.zeros(len(problem.budget))
    end = solver(lambda omega: dual(problem, omega), start, jac=True, method="L-BFGS-B", options=options)
    return InnerOptimum(float(-end.x.min()), float(np.abs(end.jac).max()))


def inner_rows() -> list[dict[str, Any]]:
    """The largest cost by variant and tolerance."""
    rows = list[dict[str, Any]]()
    for name, case in VARIANTS.items():
        problem = Problem(case, 1, 0)
        rows += [
            {"inner problem": name, "tolerance": tolerance, **inner_optimum(problem, tolerance)._asdict()}
            for tolerance in TOLERANCES
        ]
    return rows
