"""Edge schedules as written in an experiment file."""

from typing import Annotated, Literal

from pydantic import Field

from mabirds_core.consensus.generators import (
    alternating_ring,
    complete_edges,
    directed_ring,
    gossip,
    random_matching,
    ring_edges,
    static,
)
from mabirds_core.consensus.schedule import EdgeSchedule, End, both_ways
from mabirds_core.errors import ExperimentError
from mabirds_core.settings import Settings

LearnerName = Annotated[str, Field(pattern=r"^[a-z][a-z0-9_]*$", max_length=60)]


class StaticSchedule(Settings):
    """The same undirected edges at every iteration."""

    kind: Literal["static"]
    graph: Literal["complete", "ring"] = "complete"

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners."""
        edges = {"complete": complete_edges, "ring": ring_edges}[self.graph]
        return static(learners, edges(len(learners)))


class AlternatingSchedule(Settings):
    """Every other edge of the ring of learners, in turns."""

    kind: Literal["alternating"]

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners."""
        return alternating_ring(learners)


class DirectedRingSchedule(Settings):
    """Each learner sends to the next, the last to the first."""

    kind: Literal["directed_ring"]

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners."""
        return directed_ring(learners)


class RandomSchedule(Settings):
    """Random pairs: a matching of all learners in every slot, or a single pair (gossip)."""

    kind: Literal["random_matching", "gossip"]
    slots: int = Field(ge=1, le=100_000, description="drawn once, then repeated")
    seed: int = Field(0, ge=0)

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners.

        Raises
        ------
        ScheduleError
            The slots are too few to connect them.
        """
        generator = {"random_matching": random_matching, "gossip": gossip}[self.kind]
        return generator(learners, self.slots, self.seed)


class ExplicitSchedule(Settings):
    """Slots written out: lists of [sender, receiver] names."""

    kind: Literal["slots"]
    slots: tuple[tuple[tuple[LearnerName, LearnerName], ...], ...] = Field(min_length=1)
    undirected: bool = Field(False, description="open every edge both ways")
    end: End = Field("repeat", description="after the last slot: repeat them, hold the last one, or stop")

    def build(self, learners: tuple[str, ...]) -> EdgeSchedule:
        """The schedule for these learners.

        Raises
        ------
        ExperimentError
            A name is none of them.
        """
        index = {name: number for number, name in enumerate(learners)}
        for name in (name for slot in self.slots for edge in slot for name in edge):
            if name not in index:
                raise ExperimentError(f"schedule: {name!r} is none of the learners {list(learners)}")
        slots = [[(index[sender], index[receiver]) for sender, receiver in slot] for slot in self.slots]
        opened = tuple(both_ways(slot) if self.undirected else frozenset(slot) for slot in slots)
        return EdgeSchedule(learners, opened, self.end)
