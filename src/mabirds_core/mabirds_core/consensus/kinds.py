"""The entry points of the edge schedules and the mixers."""

from mabirds_core.consensus.push_sum_mixer import ResilientMixing
from mabirds_core.consensus.schedule_settings import (
    AlternatingSchedule,
    DirectedRingSchedule,
    ExplicitSchedule,
    RandomSchedule,
    StaticSchedule,
)
from mabirds_core.consensus.strict import StrictMixing
from mabirds_core.registry import Kind

STATIC = Kind(StaticSchedule, StaticSchedule.build)
ALTERNATING = Kind(AlternatingSchedule, AlternatingSchedule.build)
DIRECTED_RING = Kind(DirectedRingSchedule, DirectedRingSchedule.build)
RANDOM = Kind(RandomSchedule, RandomSchedule.build)
EXPLICIT = Kind(ExplicitSchedule, ExplicitSchedule.build)

STRICT = Kind(StrictMixing, StrictMixing.mixer)
RESILIENT = Kind(ResilientMixing, ResilientMixing.mixer)
