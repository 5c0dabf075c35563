"""What the benchmark is to show, and whether it does."""

from collections.abc import Iterator, Sequence

from mabirds_bringup.bench.cases import MABIRDS
from mabirds_bringup.bench.continuous.cases import LATTICE, SOFT_ACTOR_CRITIC
from mabirds_bringup.bench.continuous.outcome import Outcome
from mabirds_bringup.bench.continuous.tables import Row, rows
from mabirds_bringup.bench.tables import name_of
from mabirds_bringup.bench.targets import Target

AT_MOST = {
    MABIRDS: 0.025,
    "BICS": 0.015 + 0.015,
    "FTL": 0.015 + 0.010,
    "DLM": 0.020 + 0.015,
    "ME-gradient": 0.013 + 0.013,
}
"""Violation rates: the paper's Table 3, mean + half-width."""

AT_LEAST = {
    MABIRDS: 0.974,
    "BICS": 0.979 - 0.020,
    "FTL": 0.981 - 0.018,
    "DLM": 0.975 - 0.015,
    "ME-gradient": 0.980 - 0.018,
}
"""Success rates: the same table, mean - half-width; of MA-BIRDS the mean."""

MOST_SECONDS = {LATTICE: 0.5, SOFT_ACTOR_CRITIC: 3.0}
"""Of an iteration of a learner."""


def targets(outcomes: Sequence[Outcome]) -> list[Target]:
    """Rates, times, and what learned costs say; of the lattice, then of soft actor-critics."""
    found = list[Target]()
    for group in (LATTICE, SOFT_ACTOR_CRITIC):
        own = [row for row in rows(outcomes) if row.group == group]
        found += [*_rates(own), *_seconds(own), *_costs(own)]
    return found


def _rates(of: Sequence[Row]) -> Iterator[Target]:
    for row in of:
        by_name = {"": (row.violation_rate, row.success_rate)}
        if row.actor_violation_rate and row.actor_success_rate:
            by_name["actor's "] = (row.actor_violation_rate, row.actor_success_rate)
        for whose, (violation, success) in by_name.items():
            yield Target(f"{_name(row)} {whose}violation_rate", violation.mean, AT_MOST[row.label], at_most=True)
            yield Target(f"{_name(row)} {whose}success_rate", success.mean, AT_LEAST[row.label], at_most=False)


def _name(row: Row) -> str:
    return name_of(row) if row.group == LATTICE else f"soft actor-critic, {name_of(row)}"


def _seconds(of: Sequence[Row]) -> Iterator[Target]:
    """Learners are quick; methods with an inner loop cost at least five times as much an iteration."""
    learners = [row for row in of if row.label == MABIRDS]
    for row in learners:
        limit = MOST_SECONDS[row.group]
        yield Target(f"{_name(row)} seconds an iteration", row.iteration_seconds, limit, at_most=True)
    fastest = min((row.iteration_seconds for row in learners), default=1.0)
    for row in of:
        if row.label in {"FTL", "DLM"}:
            ratio = row.iteration_seconds / fastest
            yield Target(f"{_name(row)} time an iteration / MA-BIRDS", ratio, 5.0, at_most=False)


def _costs(of: Sequence[Row]) -> Iterator[Target]:
    for row in of:
        if row.label == MABIRDS:
            yield Target(
                f"{_name(row)} share of pillars that cost more than ways flown", row.dear_pillars, 1.0, at_most=False
            )
            if row.dear_closeness is not None:
                yield Target(
                    f"{_name(row)} share of seeds where closeness costs", row.dear_closeness, 1.0, at_most=False
                )
