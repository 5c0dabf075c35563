"""The edge schedule: which learner may send to which at iteration n, and the checks of Assumptions 2 and 3.

A schedule is a list of P slots, each a set of directed edges. Iterations n = 1..P use them in order; what comes after
is declared: they repeat, the last one is held, or the schedule stops and no run may be longer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Literal

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.digest import digest
from mabirds_core.errors import ScheduleError
from mabirds_core.weights import Edge, doubly_stochastic_weights

End = Literal["repeat", "hold", "stop"]

TOLERANCE = 1e-12
"""How far a row or column sum of W may lie from 1."""


@dataclass(frozen=True)
class EdgeSchedule:
    """E(n) for all n: ``slots[k]`` holds (sender, receiver) pairs of indices into ``learners``.

    ``end``: what follows the last slot.
    """

    learners: tuple[str, ...]
    slots: tuple[frozenset[Edge], ...]
    end: End = "repeat"

    def __post_init__(self) -> None:
        """Raise ScheduleError for duplicated names, no slot, self-loops or edges to nowhere."""
        if len(set(self.learners)) != len(self.learners) or not self.learners:
            raise ScheduleError(f"learners {list(self.learners)}: expected at least one, each named once")
        if not self.slots:
            raise ScheduleError("expected at least one slot; a slot without edges is written as an empty list")
        for sender, receiver in self.all_edges:
            if sender == receiver or not {sender, receiver} <= set(range(len(self.learners))):
                raise ScheduleError(
                    f"edge {self._name(sender)} -> {self._name(receiver)}: expected two different learners of"
                    f" {list(self.learners)}"
                )

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
        if self.end == "stop" and iteration > period:
            raise ScheduleError(f"iteration {iteration}: the schedule stops after its {period} slots; add slots")
        return min(iteration, period) - 1 if self.end == "hold" else (iteration - 1) % period

    def in_neighbours(self, learner: int, iteration: int) -> list[int]:
        """Whose parameters of iteration n the learner mixes in, sorted."""
        return sorted(sender for sender, receiver in self.edges(iteration) if receiver == learner)

    def ever_in_neighbours(self, learner: int) -> list[int]:
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

    def windows(self, length: int) -> list[list[int]]:
        """Slots of every ``length`` consecutive iterations, each different window once."""
        period = len(self.slots)
        starts = range(1, period - length + 2) if self.end == "stop" else range(1, period + 1)
        return [[self._slot(start + k) for k in range(length)] for start in starts]


@dataclass(frozen=True)
class ScheduleReport:
    """What ``validate`` found: B of Assumption 2, epsilon of Assumption 3, and how fast disagreement shrinks.

    ``contraction``: the largest factor by which B consecutive iterations of mixing may scale the distance to the mean.
    """

    window: int
    smallest_weight: float
    largest_sum_error: float
    contraction: float


def validate(schedule: EdgeSchedule) -> ScheduleReport:
    """Check Assumptions 2 and 3; raises ScheduleError naming the edge, slot or learners that break one."""
    matrices = [schedule.weights(slot + 1) for slot in range(len(schedule.slots))]
    window = smallest_window(schedule)
    return ScheduleReport(
        window=window,
        smallest_weight=min(float(matrix[matrix > 0].min()) for matrix in matrices),
        largest_sum_error=max(_check_weights(schedule, slot, matrix) for slot, matrix in enumerate(matrices)),
        contraction=max(contraction([matrices[slot] for slot in slots]) for slots in schedule.windows(window)),
    )


def contraction(matrices: Sequence[Array]) -> float:
    """|| W_B ... W_1 - 1 1^T / N_L ||_2: 0 for agreement at once, 1 where some disagreement stays."""
    product = reduce(lambda mixed, matrix: np.asarray(matrix @ mixed), matrices)
    return float(np.linalg.norm(product - 1 / len(product), ord=2))


def smallest_window(schedule: EdgeSchedule) -> int:
    """B: every B consecutive iterations have a strongly connected union (Assumption 2)."""
    _require_connection(schedule)
    for length in range(1, len(schedule.slots)):
        unions = (frozenset().union(*(schedule.slots[slot] for slot in slots)) for slots in schedule.windows(length))
        if all(unreachable(len(schedule.learners), union) is None for union in unions):
            return length
    return len(schedule.slots)


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


Delivered = Mapping[int, Sequence[Sequence[str]]]
"""By iteration n: for each learner, in the order of the schedule, the names of those whose parameters it mixed."""


def delivered_edges(schedule: EdgeSchedule, senders: Sequence[Sequence[str]]) -> frozenset[Edge]:
    """The edges over which parameters really passed at one iteration."""
    index = {name: number for number, name in enumerate(schedule.learners)}
    return frozenset((index[sender], receiver) for receiver, names in enumerate(senders) for sender in names)


def differences(schedule: EdgeSchedule, delivered: Delivered) -> list[str]:
    """Edges that were scheduled and not delivered, or the reverse, by iteration and name."""
    found = []
    for n, senders in sorted(delivered.items()):
        for sender, receiver in sorted(schedule.edges(n) ^ delivered_edges(schedule, senders)):
            what = "not delivered" if (sender, receiver) in schedule.edges(n) else "delivered, not scheduled"
            found.append(f"iteration {n}: {schedule.learners[sender]} -> {schedule.learners[receiver]} {what}")
    return found
