"""The default step rule, which needs no numbers: ratios of expected to demonstrated counts, with momentum.

Where the entries of e = E_pi sum gamma^t f and of m, the same of the demonstrations, are counts (features that are
never negative, weighed linearly), a coordinate's direction is that of iterative scaling (Darroch and Ratcliff, 1972),

    g = max( log( (e + c/n) / (m + c/n) ), -2 ),        M <- .7 M + .3 a(n) g,      step = M,
    a(n) = .6 / (1 + n/10)^.75 / max(1, features that are active per step and expert)

which has no unit and no scale: twice as many visits as demonstrated are answered alike in a busy and in a lonely cell.
What the policy does much too seldom is called back by a factor of at most e^2: each feature of a long way is called
back, and without that bound learners whose neighbours hear of it late throw each other from one way to the other.
c/n is a prior of visits that were not demonstrated. It is small for omega, so that what is never shown soon costs, and
larger for theta, so that a move that happens not to be among the first demonstrations is not ruled out.

Other coordinates, such as the weights of a network, take AdaGrad's steps with momentum (Duchi, Hazan and Singer, 2011):

    g = e - m,     A <- A + g^2,     M <- .8 M + .2 g,      step = M / sqrt(A (1 + n/4))

which fall as 1/n where rollouts, and demonstrations that pass an obstacle on either side, turn g again and again.
M and A are a learner's own; theta and omega alone are exchanged. The ratios' steps vanish and their squares are
summable, as Theorem 1 asks; they are no multiples of the gradient, and learners who saw other demonstrations take other
ones, which it does not allow for (docs/theory.md).
"""

from functools import lru_cache
from typing import Literal, NamedTuple

import numpy as np

from mabirds_core.algorithm.gradient import GradientEstimate
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.steps import RuleState
from mabirds_core.arithmetic import exp, log
from mabirds_core.arrays import Mask, Vector
from mabirds_core.settings import Settings

PRIOR = {"theta": 0.1, "omega": 0.001}
"""c: discounted visits."""

RATE, SLOWER_AFTER, DECAY, MOMENTUM = 0.6, 10.0, 0.75, 0.7
"""Of the ratios."""

AT_ONCE = 256
"""Iterations whose a(n) are found together: of one alone it takes as long."""

CALL_BACK = 2.0
"""The largest -g."""

MIN_ACTIVE = 1.0
"""Features that are active, at least: demonstrations may show none of those that only say what is forbidden."""

EXPECTED = 1e-6
"""Counts that are expected to be less tell nothing: they are rounding."""

ADAGRAD_MOMENTUM, FLOOR, SETTLES_AFTER = 0.8, 1e-12, 4.0
"""Of other coordinates; FLOOR keeps a coordinate at rest whose gradient was always 0."""


class _Move(NamedTuple):
    """theta's part or omega's: the step, and the M and A that the rule remembers after it."""

    step: Vector
    momentum: Vector
    squares: Vector

    def put(self, where: Mask, values: "_Move") -> None:
        """Set some coordinates."""
        for mine, theirs in zip(self, values, strict=True):
            mine[where] = theirs


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
        """What is taken off each, and M and A after it."""
        rate, moves = _rate(estimate, n), dict[str, _Move]()
        for name in Parameters._fields:
            momentum, squares = state[f"momentum.{name}"], state[f"squares.{name}"]
            expected, demonstrated = getattr(estimate.imagined, name), getattr(estimate.observed, name)
            counts, prior = getattr(estimate.counts, name), PRIOR[name] / n
            if counts is True:  # nothing else to be done, and no copies
                after = _ratio_momentum(momentum, expected, demonstrated, prior, rate)
                moves[name] = _Move(after, after, squares)
                continue
            moves[name] = move = _Move(*(np.zeros_like(momentum) for _ in _Move._fields))
            counts = np.broadcast_to(counts, momentum.shape)
            after = _ratio_momentum(momentum[counts], expected[counts], demonstrated[counts], prior, rate)
            move.put(counts, _Move(after, after, squares[counts]))
            gradient = estimate.window_fill * (expected - demonstrated)
            move.put(~counts, _adagrad(momentum[~counts], squares[~counts], gradient[~counts], n))
        remembered = {
            f"{part}.{name}": getattr(move, part) for name, move in moves.items() for part in ("momentum", "squares")
        }
        return Parameters(*(moves[name].step for name in Parameters._fields)), remembered

    def reveal(
        self, state: RuleState, step: Parameters, estimate: GradientEstimate, n: int
    ) -> tuple[Parameters, RuleState]:
        """Undo ``step`` where it is of ratios.

        Of a(n), which hangs on how many features were active, the steps tell as well: none is longer than that of a
        coordinate that was never demonstrated. Where a step is as long as -g can be, the count is the least it can be.
        """
        names = [name for name in Parameters._fields if np.all(getattr(estimate.counts, name))]
        rises = {name: getattr(step, name) - MOMENTUM * state[f"momentum.{name}"] for name in names}
        imagined = {name: np.maximum(getattr(estimate.imagined, name), 0.0) for name in names}
        rate = max((_rate_behind(rises[name], imagined[name], PRIOR[name] / n) for name in names), default=0.0)
        observed = {
            name: (imagined[name] + prior) * np.exp(-rises[name] / ((1 - MOMENTUM) * rate)) - prior
            for name, prior in ((name, PRIOR[name] / n) for name in names)
            if rate > 0
        }
        unknown = {name: np.full_like(getattr(step, name), np.nan) for name in Parameters._fields}
        remembered = {**state, **{f"momentum.{name}": getattr(step, name) for name in names}}
        return Parameters(**{**unknown, **observed}), remembered


def _ratio_momentum(momentum: Vector, expected: Vector, demonstrated: Vector, prior: float, rate: float) -> Vector:
    """M <- .7 M + .3 a(n) g; rounding may leave an expectation below 0 by some 1e-17."""
    ratio = np.maximum(log((np.maximum(expected, 0.0) + prior) / (demonstrated + prior)), -CALL_BACK)
    return np.asarray(MOMENTUM * momentum + (1 - MOMENTUM) * rate * ratio)


def _rate_behind(rises: Vector, imagined: Vector, prior: float) -> float:
    """The least a(n) by which no count that was demonstrated is negative."""
    expected = imagined > EXPECTED
    longest = (1 - MOMENTUM) * np.log((imagined[expected] + prior) / prior)
    return float((rises[expected] / longest).max(initial=0.0))


def _adagrad(momentum: Vector, squares: Vector, gradient: Vector, n: int) -> _Move:
    """A <- A + g^2, M <- .8 M + .2 g, step M / sqrt(A (1 + n/4))."""
    squares = squares + gradient**2
    momentum = ADAGRAD_MOMENTUM * momentum + (1 - ADAGRAD_MOMENTUM) * gradient
    return _Move(momentum / np.sqrt((squares + FLOOR) * (1 + n / SETTLES_AFTER)), momentum, squares)


def _rate(estimate: GradientEstimate, n: int) -> float:
    """a(n): the more features are active at a time, the less each of them has to do."""
    counted = (
        (values if counts is True else values[np.broadcast_to(counts, values.shape)]).sum()
        for values, counts in zip(estimate.observed, estimate.counts, strict=True)
    )
    active = sum(counted) / estimate.mass
    return float(RATE / _slowdowns(n // AT_ONCE)[n % AT_ONCE] / max(active, MIN_ACTIVE))


@lru_cache(maxsize=4)
def _slowdowns(part: int) -> list[float]:
    """(1 + n/10)^.75 of AT_ONCE iterations."""
    numbers = np.arange(part * AT_ONCE, (part + 1) * AT_ONCE)
    slowdowns: list[float] = exp(DECAY * log(1 + numbers / SLOWER_AFTER)).tolist()
    return slowdowns
