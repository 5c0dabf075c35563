"""The edge schedule: which learner may send to which at iteration n, and the checks of Assumptions 2 and 3.

A schedule is a list of slots, each a set of directed edges; iteration n = 1, 2, ... uses slot (n - 1) mod P.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.digest import digest
from mabirds_core.errors import ScheduleError
from mabirds_core.weights import Edge, doubly_stochastic_weights

TOLERANCE = 1e-12
"""How far a row or column sum of W may lie from 1."""


@dataclass(frozen=True)
class EdgeSchedule:
    """E(n) for all n: ``slots[k]`` holds (sender, receiver) pairs of indices into ``learners``."""

    learners: tuple[str, ...]
    slots: tuple[frozenset[Edge], ...]

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
        return self.slots[(iteration - 1) % len(self.slots)]

    def in_neighbours(self, learner: int, iteration: int) -> list[int]:
        """Whose parameters of iteration n the learner mixes in, sorted."""
        return sorted(sender for sender, receiver in self.edges(iteration) if receiver == learner)

    def ever_in_neighbours(self, learner: int) -> list[int]:
        """Whose parameters the learner mixes in at some iteration, sorted: whom it subscribes to."""
        return sorted({sender for sender, receiver in self.all_edges if receiver == learner})

    def weights(self, iteration: int) -> Array:
        """W(n), shape (N_L, N_L); row v mixes for learner v."""
        return self._weights[(iteration - 1) % len(self.slots)]

    @cached_property
    def _weights(self) -> list[Array]:
        return [doubly_stochastic_weights(len(self.learners), edges, self.learners) for edges in self.slots]

    @cached_property
    def digest(self) -> str:
        """SHA-256 of learners and slots."""
        return digest({"learners": self.learners, "slots": [sorted(slot) for slot in self.slots]})


@dataclass(frozen=True)
class ScheduleReport:
    """What ``validate`` found: B of Assumption 2 and epsilon of Assumption 3."""

    window: int
    smallest_weight: float
    largest_sum_error: float


def validate(schedule: EdgeSchedule) -> ScheduleReport:
    """Check Assumptions 2 and 3; raises ScheduleError naming the edge, slot or learners that break one."""
    matrices = [schedule.weights(slot + 1) for slot in range(len(schedule.slots))]
    return ScheduleReport(
        window=smallest_window(schedule),
        smallest_weight=min(float(matrix[matrix > 0].min()) for matrix in matrices),
        largest_sum_error=max(_check_weights(schedule, slot, matrix) for slot, matrix in enumerate(matrices)),
    )


def smallest_window(schedule: EdgeSchedule) -> int:
    """B: every B consecutive slots, with wrap-around, have a strongly connected union (Assumption 2)."""
    period, n_learners = len(schedule.slots), len(schedule.learners)
    for window in range(1, period + 1):
        unions = (
            frozenset().union(*(schedule.slots[(start + k) % period] for k in range(window))) for start in range(period)
        )
        if all(unreachable(n_learners, union) is None for union in unions):
            return window
    sender, receiver = unreachable(n_learners, frozenset(schedule.all_edges)) or (0, 0)
    raise ScheduleError(
        f"nothing that {schedule.learners[sender]} knows ever reaches {schedule.learners[receiver]}: the union of all"
        f" slots is not strongly connected (Assumption 2); add edges on the way"
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


def static(learners: Sequence[str], edges: Sequence[Edge]) -> EdgeSchedule:
    """The same undirected graph at every iteration."""
    return EdgeSchedule(tuple(learners), (both_ways(edges),))


def complete_edges(n_learners: int) -> list[Edge]:
    """Every pair of learners once."""
    return [(u, v) for u in range(n_learners) for v in range(u + 1, n_learners)]


def ring_edges(n_learners: int) -> list[Edge]:
    """Each learner to the next, the last to the first; one pair where there are only two."""
    return sorted({(min(v, w), max(v, w)) for v in range(n_learners) for w in [(v + 1) % n_learners] if v != w})


def alternating_ring(learners: Sequence[str]) -> EdgeSchedule:
    """Every other edge of the ring, then the rest: (1,2)(3,4).. and (2,3)(4,1)..; an odd ring takes a third slot.

    With two learners the second slot has no edge: they talk at every other iteration.
    """
    count = len(learners)
    ring = [(v, (v + 1) % count) for v in range(count)] if count > 2 else [(0, 1)][: count - 1]
    slots = [ring[0::2], ring[1::2]]
    if count > 2 and count % 2:
        slots = [ring[0:-1:2], ring[1::2], ring[-1:]]
    return EdgeSchedule(tuple(learners), tuple(both_ways(slot) for slot in slots))


def both_ways(edges: Sequence[Edge]) -> frozenset[Edge]:
    """The undirected edges as directed ones."""
    return frozenset(edge for u, v in edges for edge in ((u, v), (v, u)))
