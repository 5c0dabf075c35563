"""The edge schedule: which learner may send to which at iteration n, and the checks of Assumptions 2 and 3.

A schedule is a list of P slots, each a set of directed edges. Iterations n = 1..P use them in order; what comes after
is declared: they repeat, the last one is held, or the schedule stops and no run may be longer.
"""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from itertools import accumulate
from typing import Literal

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.consensus.weights import Edge, doubly_stochastic_weights
from mabirds_core.digest import digest
from mabirds_core.errors import ScheduleError
from mabirds_core.texts import truncate

End = Literal["repeat", "hold", "stop"]

TOLERANCE = 1e-12
"""How far a row or column sum of W may lie from 1."""

MAX_SLOTS = 100_000
"""Slots of a schedule: seconds of checking."""

MAX_WEIGHTS = 5_000_000
"""Entries of the weights W of all slots together: seconds of checking, some ten megabytes."""


@dataclass(frozen=True)
class EdgeSchedule:
    """E(n) for all n: ``slots[k]`` holds (sender, receiver) pairs of indices into ``learners``.

    ``end``: what follows the last slot.
    """

    learners: tuple[str, ...]
    slots: tuple[frozenset[Edge], ...]
    end: End = "repeat"

    def __post_init__(self) -> None:
        """Raise ScheduleError for duplicated names, no slot, self-loops, edges to nowhere, or too large a schedule."""
        if len(set(self.learners)) != len(self.learners) or not self.learners:
            raise ScheduleError(f"learners {self._names}: expected at least one, each named once")
        if not self.slots:
            raise ScheduleError("expected at least one slot; a slot without edges is written as an empty list")
        require_size(len(self.learners), len(self.slots))
        for sender, receiver in self.all_edges:
            if sender == receiver or min(sender, receiver) < 0 or max(sender, receiver) >= len(self.learners):
                raise ScheduleError(
                    f"edge {self._name(sender)} -> {self._name(receiver)}: expected two different learners of"
                    f" {self._names}"
                )

    @property
    def _names(self) -> str:
        return truncate(str(list(self.learners)), most=400)

    def _name(self, learner: int) -> str:
        return self.learners[learner] if 0 <= learner < len(self.learners) else f"learner number {learner}"

    @property
    def all_edges(self) -> list[Edge]:
        """Every edge that some slot opens, sorted."""
        return sorted(frozenset().union(*self.slots))

    def edges(self, iteration: int) -> frozenset[Edge]:
        """E(n), n >= 1."""
        return self.slots[self._slot(iteration)]

    def _slot(self, iteration: int) -> int:
        """Which slot iteration n uses; raises ScheduleError after the last one of a schedule that stops."""
        period = len(self.slots)
        if self._is_over(iteration):
            raise ScheduleError(f"iteration {iteration}: the schedule stops after its {period} slots; add slots")
        return min(iteration, period) - 1 if self.end == "hold" else (iteration - 1) % period

    def _is_over(self, iteration: int) -> bool:
        """Is n after the last slot of a schedule that stops?"""
        return self.end == "stop" and iteration > len(self.slots)

    def in_neighbours(self, learner: int, iteration: int) -> list[int]:
        """Whose parameters of iteration n the learner mixes in, sorted; nobody's after the end of a schedule."""
        if self._is_over(iteration):
            return []
        return sorted(sender for sender, receiver in self.edges(iteration) if receiver == learner)

    def senders_to(self, name: str, iteration: int) -> list[str]:
        """Names of the in-neighbours of E(n), in the order of ``learners``."""
        return [self.learners[u] for u in self.in_neighbours(self.learners.index(name), iteration)]

    def receivers_of(self, name: str, iteration: int) -> list[str]:
        """Names of the out-neighbours of E(n), in the order of ``learners``; none after the end of a schedule."""
        if self._is_over(iteration):
            return []
        index = self.learners.index(name)
        return [self.learners[receiver] for sender, receiver in sorted(self.edges(iteration)) if sender == index]

    def all_in_neighbours(self, learner: int) -> list[int]:
        """Whose parameters the learner mixes in at some iteration, sorted: whom it subscribes to."""
        return sorted({sender for sender, receiver in self.all_edges if receiver == learner})

    def weights(self, iteration: int) -> Array:
        """W(n), shape (N_L, N_L); row v mixes for learner v."""
        return self._weights[self._slot(iteration)]

    @cached_property
    def _weights(self) -> list[Array]:
        return [doubly_stochastic_weights(len(self.learners), edges, self.learners) for edges in self.slots]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of learners, slots and end."""
        return digest({"learners": self.learners, "slots": [sorted(slot) for slot in self.slots], "end": self.end})

    def last_start(self, length: int) -> int:
        """The windows of ``length`` consecutive iterations begin at 1, ..., this; later ones only repeat them."""
        return len(self.slots) - length + 1 if self.end == "stop" else len(self.slots)


def require_size(n_learners: int, slots: int) -> None:
    """Raise ScheduleError where so many slots of so many learners cannot be checked in seconds."""
    most = min(MAX_SLOTS, MAX_WEIGHTS // n_learners**2)
    if slots > most:
        raise ScheduleError(f"{slots} slots: expected at most {most} for {n_learners} learners; take fewer")


@dataclass(frozen=True)
class ScheduleReport:
    """What ``validate`` found: B of Assumption 2, epsilon of Assumption 3, and how fast disagreement shrinks.

    ``contraction``: the largest factor by which B consecutive iterations of mixing may scale the distance to the mean.
    """

    connectivity_window: int
    smallest_weight: float
    largest_sum_error: float
    contraction: float


def validate(schedule: EdgeSchedule) -> ScheduleReport:
    """Check Assumptions 2 and 3; raises ScheduleError naming the edge, slot or learners that break one."""
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
    """B: every B consecutive iterations have a strongly connected union (Assumption 2)."""
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
    """A pair (u, v) with no directed way from u to v, or None: the graph is strongly connected."""
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


def both_ways(edges: Sequence[Edge]) -> frozenset[Edge]:
    """The undirected edges as directed ones."""
    return frozenset(edge for u, v in edges for edge in ((u, v), (v, u)))


DeliveredEdges = Mapping[int, Sequence[Sequence[str]]]
"""By iteration n: for each learner, in the order of the schedule, the names of those whose parameters it mixed."""


def delivered_edges(schedule: EdgeSchedule, senders: Sequence[Sequence[str]]) -> frozenset[Edge]:
    """The edges over which parameters really passed at one iteration."""
    index = {name: number for number, name in enumerate(schedule.learners)}
    strangers = sorted({name for names in senders for name in names} - index.keys())
    if strangers:
        raise ScheduleError(f"{truncate(str(strangers))}: expected learners of {schedule.learners}")
    return frozenset((index[sender], receiver) for receiver, names in enumerate(senders) for sender in names)


def edge_mismatches(schedule: EdgeSchedule, delivered: DeliveredEdges) -> list[str]:
    """Edges that were scheduled and not delivered, or the reverse, by iteration and name."""
    mismatches = []
    for n, senders in sorted(delivered.items()):
        for sender, receiver in sorted(schedule.edges(n) ^ delivered_edges(schedule, senders)):
            what = "not delivered" if (sender, receiver) in schedule.edges(n) else "delivered, not scheduled"
            mismatches.append(f"iteration {n}: {schedule.learners[sender]} -> {schedule.learners[receiver]} {what}")
    return mismatches
