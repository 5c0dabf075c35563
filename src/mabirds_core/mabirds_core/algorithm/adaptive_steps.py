"""The default step rule, which needs no numbers: ratios of expected to demonstrated counts, with momentum.

Where the entries of e = E_pi sum gamma^t f and of m, the same of the demonstrations, are counts (features that are
never negative, weighed linearly), a coordinate's direction is that of iterative scaling (Darroch and Ratcliff, 1972),

    g = log( (e + c/n) / (m + c/n) ),        M <- .7 M + .3 a(n) g,      step = M,
    a(n) = .6 / (1 + n/10)^.75 / max(1, features that are active per step and expert)

which has no unit and no scale: twice as many visits as demonstrated are answered alike in a busy and in a lonely cell.
c/n is a prior of visits that were not demonstrated. It is small for omega, so that what is never shown soon costs, and
larger for theta, so that a move that happens not to be among the first demonstrations is not ruled out.

Other coordinates, such as the weights of a network, take AdaGrad's steps with momentum (Duchi, Hazan and Singer, 2011):

    g = e - m,     A <- A + g^2,     M <- .8 M + .2 g,      step = M / sqrt(A)

M and A are a learner's own; theta and omega alone are exchanged. Both kinds of step vanish as n grows and are the same
for all learners in expectation, as Theorem 1 asks; their size depends on the data, which it does not allow for.
"""

from typing import Literal, NamedTuple

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimate
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.steps import RuleState
from mabirds_core.arrays import Array, Vector
from mabirds_core.settings import Settings

PRIOR = {"theta": 0.1, "omega": 0.001}
"""c: discounted visits."""

RATE, SLOWER_AFTER, DECAY, MOMENTUM = 0.6, 10.0, 0.75, 0.7
"""Of the ratios."""

MIN_ACTIVE = 1.0
"""Features that are active, at least: demonstrations may show none of those that only say what is forbidden."""

ADAGRAD_MOMENTUM, FLOOR = 0.8, 1e-12
"""Of other coordinates; FLOOR keeps a coordinate at rest whose gradient was always 0."""


class _Coordinates(NamedTuple):
    """theta's part or omega's: what is expected and demonstrated, and what the rule remembers of it."""

    expected: Vector
    demonstrated: Vector
    momentum: Vector
    squares: Vector


class AdaptiveSteps(Settings):
    """Steps that need no numbers."""

    kind: Literal["adaptive"] = "adaptive"

    def initial(self, parameters: Parameters) -> RuleState:
        """M = A = 0: momentum and sums of squares of theta and omega."""
        return {
            f"{part}.{name}": np.zeros_like(values)
            for name, values in parameters._asdict().items()
            for part in ("momentum", "squares")
        }

    def step(self, state: RuleState, estimate: GradientEstimate, n: int) -> tuple[Parameters, RuleState]:
        """M of theta and omega."""
        rate = _rate(estimate, n)
        steps, after = dict[str, Vector](), dict[str, Array]()
        for name in Parameters._fields:
            expected, demonstrated = getattr(estimate.imagined, name), getattr(estimate.observed, name)
            of = _Coordinates(expected, demonstrated, state[f"momentum.{name}"], state[f"squares.{name}"])
            if getattr(estimate.counts, name):
                after[f"momentum.{name}"] = _ratio_momentum(of, PRIOR[name] / n, rate)
                after[f"squares.{name}"] = of.squares
                steps[name] = after[f"momentum.{name}"]
            else:
                gradient = estimate.window_fill * (of.expected - of.demonstrated)
                after[f"squares.{name}"] = of.squares + gradient**2
                after[f"momentum.{name}"] = ADAGRAD_MOMENTUM * of.momentum + (1 - ADAGRAD_MOMENTUM) * gradient
                steps[name] = after[f"momentum.{name}"] / np.sqrt(after[f"squares.{name}"] + FLOOR)
        return Parameters(**steps), after


def _ratio_momentum(of: _Coordinates, prior: float, rate: float) -> Vector:
    """M <- .7 M + .3 a(n) log((e + c/n) / (m + c/n)); rounding may leave an expectation below 0 by some 1e-17."""
    ratio = np.log((np.maximum(of.expected, 0.0) + prior) / (of.demonstrated + prior))
    return np.asarray(MOMENTUM * of.momentum + (1 - MOMENTUM) * rate * ratio)


def _rate(estimate: GradientEstimate, n: int) -> float:
    """a(n): the more features are active at a time, the less each of them has to do."""
    counted = [values.sum() for values, counts in zip(estimate.observed, estimate.counts, strict=True) if counts]
    active = sum(counted) / estimate.mass
    return float(RATE / (1 + n / SLOWER_AFTER) ** DECAY / max(active, MIN_ACTIVE))
