"""What one network comes to with one seed, iteration by iteration.

theta, omega    max_v |x_v(n) - mean x(n)|: disagreement
policy          largest total variation distance of two learners' occupancy measures
violation       sum over the true constraints k of sum_{i<=n} (E_pi(i) mu_k - b_k), mean over learners
reward_gap      mean over i <= n of |E_pi(i) r - E_experts r|, mean over learners; r: the experts' reward
regret          mean over i <= n of |mean_v grad_theta of the window's loss|^2
population      the same of the loss of the experts' exact expectation in place of the window
largest_cost    largest -omega of learner 1
floor           trace of the covariance of the demonstrations' grad J, over N_L l: what noise alone makes of regret
"""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from mabirds_bringup.bench.results import CaseResult, MetricsRow
from mabirds_bringup.bench.theory.cases import N_LEARNERS, TheoryCase
from mabirds_bringup.bench.theory.network import Iterate, iterates
from mabirds_bringup.bench.theory.problem import Problem
from mabirds_bringup.bench.theory.slopes import bin_means, bins
from mabirds_core.arrays import Vector
from mabirds_core.games.interface import discounted_visitation
from mabirds_core.metrics.metrics import consensus_distance, policy_distance

AT_BIN = ("theta", "omega", "policy", "largest_cost")
"""Means over the iterations of a bin."""
RUNNING = ("reward_gap", "regret", "population")
"""Means over all iterations until the bin's end; violation is their sum."""
POLICIES_PER_BIN = 4
"""Iterations of a bin at which policies are compared: it takes long."""


def measure(case: TheoryCase, iterations: int, seed: int) -> CaseResult:
    """Learn the case with a seed; a row per quantity and bin, at the bin's last iteration."""
    problem = Problem(case, iterations * case.longer, seed)
    compared = policy_iterations(problem.iterations)
    values = [
        dict(_quantities(problem, network, compare=n in compared)) for n, network in enumerate(iterates(problem), 1)
    ]
    curves = {name: np.array([row[name] for row in values]) for name in values[0]}
    floor = MetricsRow(problem.iterations, "floor", demonstration_variance(problem) / (N_LEARNERS * case.window))
    return CaseResult(case.group, case.label, "network", seed, [*_rows(curves), floor])


def policy_iterations(iterations: int) -> set[int]:
    """Evenly spread over each bin, its last iteration among them."""
    spread = (of[:: -max(1, len(of) // POLICIES_PER_BIN)] for of in bins(iterations))
    return {int(n) for of in spread for n in of}


def _quantities(problem: Problem, network: Sequence[Iterate], *, compare: bool) -> Iterator[tuple[str, float]]:
    for name in ("theta", "omega"):
        yield name, consensus_distance([getattr(learner.parameters, name) for learner in network])
    policies = [learner.estimate.policy for learner in network]
    yield "policy", policy_distance(problem.game, policies) if compare else np.nan
    expected = [learner.estimate.imagined for learner in network]
    constraints = problem.game.true_constraints
    costs = np.mean([of.omega for of in expected], axis=0)
    yield "violation", float((costs - problem.budget)[constraints].sum())
    yield (
        "reward_gap",
        float(np.mean([abs(problem.true_theta @ (of.theta - problem.expert_features)) for of in expected])),
    )
    yield "regret", _square(np.mean([learner.estimate.gradient.theta for learner in network], axis=0))
    yield "population", _square(np.mean([of.theta for of in expected], axis=0) - problem.expert_features)
    yield "largest_cost", float(-network[0].parameters.omega.min())


def demonstration_variance(problem: Problem) -> float:
    """Trace of the covariance of grad J(zeta), from the demonstrations of all learners."""
    game = problem.game
    shown = (trajectory for stream in problem.streams().values() for trajectory in stream)
    totals = [game.reward_features.total(discounted_visitation(trajectory, game.discount)) for trajectory in shown]
    return float(np.var(totals, axis=0, ddof=1).sum())


def _square(vector: Vector) -> float:
    return float(vector @ vector)


def _rows(curves: Mapping[str, Vector]) -> Iterator[MetricsRow]:
    for name, values in curves.items():
        if name in AT_BIN:
            by_bin = bin_means(values)
        else:
            totals = values.cumsum()
            ends = [int(of[-1]) for of in bins(len(values))]
            by_bin = {n: float(totals[n - 1] / (n if name in RUNNING else 1)) for n in ends}
        yield from (MetricsRow(n, name, value) for n, value in by_bin.items())
