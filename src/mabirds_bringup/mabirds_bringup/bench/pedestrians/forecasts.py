"""Who says what walkers do next: the learned policy, and what is to be beaten. All are told in the same moves.

    pi(a|s)  proportional to  mu(a) exp( -|w(a) - w*(s)|^2 / 2 sigma^2 )

with w(a) the way that a move means, and w* what is expected: the way of the last step, the mean way of training near
by, or one step straight to the goal. sigma is the one that makes the training likeliest. Heavy tails: Student's density
with two numbers in place of the Gaussian. Maximum entropy without learning: mu(a) exp( b progress(a) ) of ways that are
not faster than anybody in the training, b likewise.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from mabirds_bringup.bench.pedestrians.game import normalised
from mabirds_bringup.bench.pedestrians.moves import Moves
from mabirds_bringup.bench.pedestrians.situations import Situations
from mabirds_core.arrays import Array, Indices, Vector

NOISES = np.geomspace(0.02, 2.0, 60)
"""sigma [m] that are tried."""

FREEDOMS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0, 5.0)
"""Degrees of freedom that are tried."""

DRIVES = np.geomspace(0.1, 20.0, 40)
"""b that are tried [nats/m]."""

TOO_FAST = 50.0
"""Nats that ways beyond the fastest of the training cost for each metre; a limit would make some impossible."""

NEAR = 1.0
"""Within which training counts as near by [m]."""


class Forecast(Protocol):
    """Who says how likely moves are."""

    def log_chances(self, situations: Situations) -> Array:
        """log pi(a|s), shape (M, A)."""
        ...


class Training(NamedTuple):
    """From what baselines take their numbers.

    Attributes
    ----------
    situations : Situations
        M of them.
    chosen : Indices
        The move in each, shape (M,).
    """

    situations: Situations
    chosen: Indices


Scores = Callable[[Situations], Array]
"""log pi(a|s) but for mu and a constant, shape (M, A)."""


@dataclass(frozen=True)
class Scored:
    """A forecast by scores."""

    moves: Moves
    scores: Scores

    def log_chances(self, situations: Situations) -> Array:
        """log pi(a|s), shape (M, A)."""
        scores = np.broadcast_to(self.scores(situations), (situations.size, self.moves.count))
        return normalised(scores + self.moves.log_shares)


def nats(forecast: Forecast, moves: Moves, told: Training) -> Vector:
    """log pi/mu of what was chosen, shape (M,)."""
    chances = forecast.log_chances(told.situations) - moves.log_shares
    return np.asarray(chances[np.arange(len(told.chosen)), told.chosen])


def likeliest(moves: Moves, candidates: Sequence[Scores], training: Training) -> Scored:
    """The candidate that makes the training likeliest."""
    return max((Scored(moves, of) for of in candidates), key=lambda of: float(nats(of, moves, training).mean()))


Expected = Callable[[Situations], Array]
"""w*, shape (M, 2) [m]."""


def _away(moves: Moves, expected: Expected, situations: Situations) -> Array:
    ways = moves.ways(situations.before, situations.ahead)
    return np.asarray(((ways - expected(situations)[:, None]) ** 2).sum(axis=-1))


def gaussian(moves: Moves, expected: Expected, sigma: float) -> Scores:
    """Of one sigma [m]."""
    return lambda situations: -_away(moves, expected, situations) / (2 * sigma**2)


def student(moves: Moves, expected: Expected, sigma: float, freedom: float) -> Scores:
    """Of one sigma [m] and as many degrees of freedom."""
    return lambda situations: -(freedom / 2 + 1) * np.log1p(_away(moves, expected, situations) / (freedom * sigma**2))


def baselines(moves: Moves, headings: Array, exits: Array, training: Training) -> Mapping[str, Scored]:
    """What is to be beaten.

    Parameters
    ----------
    moves : Moves
        To choose of.
    headings : Array
        Where each role goes, unit vectors, shape (2, 2).
    exits : Array
        Ends of the segment to which each role goes, shape (2, 2, 2) [m].
    training : Training
        From which they take their numbers.

    Returns
    -------
    Mapping[str, Scored]
        By name.
    """
    straight, counted = straight_to(exits, training), counted_near(moves, training)
    fastest = float(np.hypot(*training.situations.before.T).max())
    heavy = [student(moves, same_way, s, nu) for s in np.geomspace(0.005, 0.5, 40) for nu in FREEDOMS]
    return {
        "uniform": Scored(moves, lambda _: np.zeros(1)),
        "counting": likeliest(moves, [gaussian(moves, counted, s) for s in NOISES], training),
        "maximum entropy, goals told": likeliest(moves, [drive(moves, headings, fastest, b) for b in DRIVES], training),
        "straight to the goal": likeliest(moves, [gaussian(moves, straight, s) for s in NOISES], training),
        "constant velocity": likeliest(moves, [gaussian(moves, same_way, s) for s in NOISES], training),
        "constant velocity, heavy tails": likeliest(moves, heavy, training),
    }


def same_way(situations: Situations) -> Array:
    """The way of the last step."""
    return situations.before


def drive(moves: Moves, headings: Array, fastest: float, b: float) -> Scores:
    """b times the progress where the role goes [nats/m], of ways up to the fastest [m]."""

    def scores(situations: Situations) -> Array:
        ways = moves.ways(situations.before, situations.ahead)
        beyond = np.maximum(0.0, np.hypot(ways[..., 0], ways[..., 1]) - fastest)
        return np.asarray(b * (ways * headings[situations.role][:, None]).sum(axis=-1) - TOO_FAST * beyond)

    return scores


def straight_to(exits: Array, training: Training) -> Expected:
    """Straight to the nearest place of the exit, as fast as the training on average."""
    speed = float(np.hypot(*training.situations.before.T).mean())

    def expected(situations: Situations) -> Array:
        begin, end = exits[situations.role, 0], exits[situations.role, 1]
        along = ((situations.places - begin) * (end - begin)).sum(axis=1) / ((end - begin) ** 2).sum(axis=1)
        ways = begin + np.clip(along, 0.0, 1.0)[:, None] * (end - begin) - situations.places
        return np.asarray(speed * ways / np.maximum(np.hypot(*ways.T), 0.1)[:, None])

    return expected


def counted_near(moves: Moves, training: Training) -> Expected:
    """The mean way of the training's walkers of the same role near by."""
    seen = training.situations
    every = moves.ways(seen.before, seen.ahead)
    taken = every[np.arange(seen.size), training.chosen]

    def expected(situations: Situations) -> Array:
        away = ((situations.places[:, None] - seen.places) ** 2).sum(axis=-1) / NEAR**2
        away[situations.role[:, None] != seen.role] = np.inf
        weights = np.exp(-(away - away.min(axis=1, keepdims=True)) / 2)
        return np.asarray((weights @ taken) / weights.sum(axis=1, keepdims=True))

    return expected
