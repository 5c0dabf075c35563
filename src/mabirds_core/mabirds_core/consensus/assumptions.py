"""Assumptions 2 and 3 of an edge schedule, and how fast mixing by it shrinks disagreement.

Assumption 2: every B consecutive iterations have a strongly connected union. Assumption 3: W(n) is doubly stochastic
on E(n), and its entries that are not 0 are at least epsilon.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import reduce
from itertools import accumulate

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.consensus.weights import Edge
from mabirds_core.errors import ScheduleError

TOLERANCE = 1e-12
"""How far a row or column sum of W may lie from 1."""


@dataclass(frozen=True)
class ScheduleReport:
    """What ``validate`` measures of a schedule.

    Attributes
    ----------
    connectivity_window : int
        B of Assumption 2.
    smallest_weight : float
        epsilon of Assumption 3.
    largest_sum_error : float
        Largest distance of a row or column sum of any W(n) from 1.
    contraction : float
        The largest factor by which B consecutive iterations of mixing may scale the distance to the mean.
    """

    connectivity_window: int
    smallest_weight: float
    largest_sum_error: float
    contraction: float


def validate(schedule: EdgeSchedule) -> ScheduleReport:
    """Check Assumptions 2 and 3.

    Raises
    ------
    ScheduleError
        Edges, slot or learners break one; the message names them.
    """
    matrices = [schedule.weights(slot + 1) for slot in range(len(schedule.slots))]
    window = connectivity_window(schedule)
    return ScheduleReport(
        connectivity_window=window,
        smallest_weight=min(float(matrix[matrix > 0].min()) for matrix in matrices),
        largest_sum_error=max(_check_weights(schedule, slot, matrix) for slot, matrix in enumerate(matrices)),
        contraction=max(_disagreement(product) for product in _products(schedule, window)),
    )


def contraction(matrices: Sequence[Array]) -> float:
    """|| W_B ... W_1 - 1 1^T / N_L ||_2: 0 for agreement at once, 1 where some disagreement stays."""
    return _disagreement(reduce(_after, matrices))


def _after(mixed: Array, matrix: Array) -> Array:
    return np.asarray(matrix @ mixed)


def _disagreement(product: Array) -> float:
    return float(np.linalg.norm(product - 1 / len(product), ord=2))


def _products(schedule: EdgeSchedule, length: int) -> Iterator[Array]:
    """W(n + length - 1) ... W(n) for every window, three products each: the end of a block, then the next one's start.

    Blocks of ``length`` iterations stand side by side; every window is one, or begins in one and ends in the next.
    """
    last = schedule.last_start(length)
    for start in range(1, last + 1, length):
        block = [schedule.weights(n) for n in range(start, start + length)]
        *ends, whole = accumulate(reversed(block), lambda mixed, matrix: np.asarray(mixed @ matrix))
        yield whole
        further = range(start + length, min(start + 2 * length - 1, last + length))
        beginnings = accumulate((schedule.weights(n) for n in further), _after)
        for end, beginning in zip(reversed(ends), beginnings, strict=False):
            yield np.asarray(beginning @ end)


def connectivity_window(schedule: EdgeSchedule) -> int:
    """B: every B consecutive iterations have a strongly connected union (Assumption 2).

    Raises
    ------
    ScheduleError
        No B is large enough.
    """
    _require_connection(schedule)
    needed = list(accumulate(_window_lengths(schedule), max))
    lengths = range(1, len(schedule.slots) + 1)
    return next(length for length in lengths if needed[schedule.last_start(length) - 1] <= length)


def _window_lengths(schedule: EdgeSchedule) -> Iterator[float]:
    """How many iterations from n on connect all learners, for n = 1, ..., P; infinity where the schedule stops before.

    The window slides: what begins later never ends earlier.
    """
    period, end, opened = len(schedule.slots), 0, Counter[Edge]()
    for start in range(1, period + 1):
        while unreachable(len(schedule.learners), frozenset(opened)):
            end += 1
            if schedule.end == "stop" and end > period:
                yield from [np.inf] * (period + 1 - start)
                return
            opened.update(schedule.edges(end))
        yield end + 1 - start
        opened.subtract(schedule.edges(start))
        opened = +opened  # without the edges that no slot of the window opens any more


def _require_connection(schedule: EdgeSchedule) -> None:
    """Raise ScheduleError where no window is long enough."""
    held = schedule.end == "hold"
    pair = unreachable(len(schedule.learners), schedule.slots[-1] if held else frozenset(schedule.all_edges))
    if pair:
        sender, receiver = (schedule.learners[learner] for learner in pair)
        what = "the last slot, which is held," if held else "the union of all slots"
        raise ScheduleError(
            f"nothing that {sender} knows ever reaches {receiver}: {what} is not strongly connected (Assumption 2);"
            " add edges on the way"
        )


def unreachable(n_learners: int, edges: frozenset[Edge]) -> Edge | None:
    """Look for learners that are not connected.

    Parameters
    ----------
    n_learners : int
        N_L.
    edges : frozenset[Edge]
        Of a directed graph.

    Returns
    -------
    Edge or None
        A pair (u, v) with no directed way from u to v; None: the graph is strongly connected.
    """
    reach = np.eye(n_learners, dtype=bool)
    for sender, receiver in edges:
        reach[sender, receiver] = True
    for middle in range(n_learners):  # Warshall's transitive closure
        reach |= reach[:, middle : middle + 1] & reach[middle]
    missing = np.argwhere(~reach)
    return (int(missing[0][0]), int(missing[0][1])) if len(missing) else None


def _check_weights(schedule: EdgeSchedule, slot: int, matrix: Array) -> float:
    """Assumption 3 for one slot: the largest distance of a row or column sum from 1."""
    error = max(float(np.abs(matrix.sum(axis=axis) - 1).max()) for axis in (0, 1))
    support = {(int(sender), int(receiver)) for receiver, sender in np.argwhere(matrix)}
    allowed = schedule.slots[slot] | {(v, v) for v in range(len(schedule.learners))}
    if error > TOLERANCE or (matrix < 0).any() or support != allowed:
        raise ScheduleError(f"slot {slot + 1}: weights are not doubly stochastic on its edges (sums off by {error:g})")
    return error
