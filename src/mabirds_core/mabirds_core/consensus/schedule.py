"""The edge schedule: which learner may send to which at iteration n.

A schedule is a list of P slots, each a set of directed edges. Iterations n = 1..P use them in order; what comes after
is declared: they repeat, the last one is held, or the schedule stops and no run may be longer.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

from mabirds_core.arrays import Array
from mabirds_core.consensus.weights import Edge, doubly_stochastic_weights
from mabirds_core.digest import digest
from mabirds_core.errors import ScheduleError
from mabirds_core.texts import truncate

End = Literal["repeat", "hold", "stop"]

MAX_SLOTS = 100_000
"""Slots of a schedule: seconds of checking."""

MAX_WEIGHTS = 5_000_000
"""Entries of the weights W of all slots together: seconds of checking, some ten megabytes."""

MOST_KEPT = 64
"""In-neighbours of a learner in a slot that are kept once they were asked for."""


@dataclass(frozen=True)
class EdgeSchedule:
    """E(n) for all n.

    Attributes
    ----------
    learners : tuple[str, ...]
        Names.
    slots : tuple[frozenset[Edge], ...]
        Each a set of (sender, receiver) pairs of indices into ``learners``.
    end : End
        What follows the last slot.

    Raises
    ------
    ScheduleError
        A name is given twice, there is no slot, an edge is a loop or leads nowhere, or the schedule is too large.
    """

    learners: tuple[str, ...]
    slots: tuple[frozenset[Edge], ...]
    end: End = "repeat"

    def __post_init__(self) -> None:
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
        """E(n), n >= 1.

        Raises
        ------
        ScheduleError
            n is after the last slot of a schedule that stops.
        """
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
        """Whose parameters a learner mixes in at iteration n.

        Parameters
        ----------
        learner : int
            Its index v.
        iteration : int
            n, from 1 on.

        Returns
        -------
        list[int]
            Indices u of (u, v) in E(n), sorted; none after the end of a schedule that stops.
        """
        if self._is_over(iteration):
            return []
        return sorted(sender for sender, receiver in self.edges(iteration) if receiver == learner)

    def senders_to(self, name: str, iteration: int) -> list[str]:
        """Names of the in-neighbours of E(n).

        Parameters
        ----------
        name : str
            Of the learner.
        iteration : int
            n, from 1 on.

        Returns
        -------
        list[str]
            In the order of ``learners``; none after the end of a schedule that stops.
        """
        if self._is_over(iteration):
            return []
        where = name, self._slot(iteration)
        if where not in self._senders:
            if len(self._senders) >= MOST_KEPT:
                self._senders.clear()
            senders = self.in_neighbours(self.learners.index(name), iteration)
            self._senders[where] = [self.learners[u] for u in senders]
        return [*self._senders[where]]

    @cached_property
    def _senders(self) -> dict[tuple[str, int], list[str]]:
        """Some of what was asked for, by receiver and slot: it is asked for twice or thrice at each iteration."""
        return {}

    def receivers_of(self, name: str, iteration: int) -> list[str]:
        """Names of the out-neighbours of E(n).

        Parameters
        ----------
        name : str
            Of the learner.
        iteration : int
            n, from 1 on.

        Returns
        -------
        list[str]
            In the order of ``learners``; none after the end of a schedule that stops.
        """
        if self._is_over(iteration):
            return []
        index = self.learners.index(name)
        return [self.learners[receiver] for sender, receiver in sorted(self.edges(iteration)) if sender == index]

    def all_in_neighbours(self, learner: int) -> list[int]:
        """Whose parameters the learner mixes in at some iteration, sorted: whom it subscribes to."""
        return sorted({sender for sender, receiver in self.all_edges if receiver == learner})

    def weights(self, iteration: int) -> Array:
        """W(n), shape (N_L, N_L); row v mixes for learner v.

        Raises
        ------
        ScheduleError
            n is after the last slot of a schedule that stops, or an edge of the slot is on no directed cycle.
        """
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
    """Check that a schedule is small enough to be checked in seconds.

    Parameters
    ----------
    n_learners : int
        N_L.
    slots : int
        How many there are.

    Raises
    ------
    ScheduleError
        There are too many for so many learners.
    """
    most = min(MAX_SLOTS, MAX_WEIGHTS // n_learners**2)
    if slots > most:
        raise ScheduleError(f"{slots} slots: expected at most {most} for {n_learners} learners; take fewer")


def both_ways(edges: Sequence[Edge]) -> frozenset[Edge]:
    """The undirected edges as directed ones."""
    return frozenset(edge for u, v in edges for edge in ((u, v), (v, u)))


DeliveredEdges = Mapping[int, Sequence[Sequence[str]]]
"""By iteration n: for each learner, in the order of the schedule, the names of those whose parameters it mixed."""


def delivered_edges(schedule: EdgeSchedule, senders: Sequence[Sequence[str]]) -> frozenset[Edge]:
    """The edges over which parameters really passed at one iteration.

    Parameters
    ----------
    schedule : EdgeSchedule
        Of the learners.
    senders : Sequence[Sequence[str]]
        For each learner, in their order, the names of those whose parameters it mixed.

    Returns
    -------
    frozenset[Edge]
        (sender, receiver) as indices.

    Raises
    ------
    ScheduleError
        A sender is none of the learners.
    """
    index = {name: number for number, name in enumerate(schedule.learners)}
    strangers = sorted({name for names in senders for name in names} - index.keys())
    if strangers:
        raise ScheduleError(f"{truncate(str(strangers))}: expected learners of {schedule.learners}")
    return frozenset((index[sender], receiver) for receiver, names in enumerate(senders) for sender in names)


def edge_mismatches(schedule: EdgeSchedule, delivered: DeliveredEdges) -> list[str]:
    """Compare what was delivered with E(n).

    Parameters
    ----------
    schedule : EdgeSchedule
        E(n).
    delivered : DeliveredEdges
        By iteration.

    Returns
    -------
    list[str]
        Edges that were scheduled and not delivered, or the reverse, by iteration and name.

    Raises
    ------
    ScheduleError
        A sender is none of the learners.
    """
    mismatches = []
    for n, senders in sorted(delivered.items()):
        for sender, receiver in sorted(schedule.edges(n) ^ delivered_edges(schedule, senders)):
            what = "not delivered" if (sender, receiver) in schedule.edges(n) else "delivered, not scheduled"
            mismatches.append(f"iteration {n}: {schedule.learners[sender]} -> {schedule.learners[receiver]} {what}")
    return mismatches
