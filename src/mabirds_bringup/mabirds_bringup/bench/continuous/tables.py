"""The benchmark's tables: Table 3, the closing rounds, and what pillars cost."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from mabirds_bringup.bench.cases import MABIRDS
from mabirds_bringup.bench.continuous.outcome import Outcome
from mabirds_bringup.bench.tables import (
    Spread,
    by_learner,
    iteration_seconds,
    name_of,
    scaled_lines,
    spread,
    times_to_levels,
)
from mabirds_core.games.drones.settings import DroneSettings


@dataclass(frozen=True)
class Row:
    """One learner or method of one case, over all seeds. Times in seconds; None: a level that a seed never reached."""

    group: str
    label: str
    learner: str
    violation_rate: Spread
    success_rate: Spread
    updated_violation_rate: Spread
    """After the last update, before the closing rounds."""
    updated_success_rate: Spread
    actor_violation_rate: Spread | None
    """Of the policy that was found last; None where policies are found exactly."""
    actor_success_rate: Spread | None
    iteration_seconds: float
    seconds_to_level: tuple[float | None, ...]
    gradient_steps: float
    policy_solves: float
    iterations: int
    peak_memory: float
    """[MB]"""
    consensus_theta: Spread
    consensus_omega: Spread
    policy_distance: Spread
    dear_pillars: float
    """Share of pillars, drones and seeds where a pillar costs more than the ways flown."""
    dear_closeness: float | None
    """Share of pairs and seeds where every distance below the least costs more than a large one; None: no pair."""


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """One row a case and learner, in the order of the outcomes."""
    return [_row(ones) for ones in by_learner(outcomes)]


def _row(ones: list[Outcome]) -> Row:
    def over_seeds(value: Callable[[Outcome], float]) -> Spread:
        return spread([value(one) for one in ones])

    first, closeness = ones[0], [margin > 0 for one in ones for margin in one.closeness]
    return Row(
        first.group,
        first.label,
        first.learner,
        over_seeds(lambda one: one.violation_rate[-1]),
        over_seeds(lambda one: one.success_rate[-1]),
        over_seeds(lambda one: one.violation_rate[len(one.seconds)]),
        over_seeds(lambda one: one.success_rate[len(one.seconds)]),
        over_seeds(lambda one: one.actor_violation_rate[-1]) if first.actor_violation_rate else None,
        over_seeds(lambda one: one.actor_success_rate[-1]) if first.actor_success_rate else None,
        iteration_seconds(ones),
        times_to_levels(ones),
        float(np.mean([one.gradient_steps for one in ones])),
        float(np.mean([one.policy_solves for one in ones])),
        len(first.seconds),
        float(np.mean([one.peak_memory for one in ones])),
        over_seeds(lambda one: one.consensus_theta[-1]),
        over_seeds(lambda one: one.consensus_omega[-1]),
        over_seeds(lambda one: one.policy_distance),
        float(np.mean([is_dear for one in ones for is_dear in dear_pillars(one).values()] or [True])),
        float(np.mean(closeness)) if closeness else None,
    )


def dear_pillars(one: Outcome) -> dict[tuple[int, int], bool]:
    """By drone and pillar: do touching it and its rim each cost more than the ways that were flown?"""
    pairs = product(range(len(one.flown)), range(len(one.pillar_inside[0])))
    return {(d, p): min(one.pillar_inside[d][p], one.pillar_rim[d][p]) > one.flown[d] for d, p in pairs}


COLUMNS = (
    "",
    "CVR",
    "SR",
    "STPOI",
    "50% ST",
    "90% ST",
    "gradient steps",
    "policy solves",
    "seconds",
    "memory [MB]",
)
ACTOR_COLUMNS = (*COLUMNS[:3], "actor's CVR", "actor's SR", *COLUMNS[3:])


def table(of: Sequence[Row]) -> tuple[Sequence[str], list[list[str]]]:
    """Table 3: columns, and a line a row. STPOI: time an online iteration, scaled."""
    actors = any(row.actor_success_rate for row in of)
    times = scaled_lines([[row.iteration_seconds, *row.seconds_to_level] for row in of])
    lines = [
        [name_of(row), *_rates(row)[: 4 if actors else 2], *own, *_work(row)]
        for row, own in zip(of, times, strict=True)
    ]
    return (ACTOR_COLUMNS if actors else COLUMNS), lines


def _rates(row: Row) -> list[str]:
    """Those of the parameters, then those of the actor, empty where there is none."""
    rates = (row.violation_rate, row.success_rate, row.actor_violation_rate, row.actor_success_rate)
    return [str(rate or "") for rate in rates]


def _work(row: Row) -> list[str]:
    return [
        f"{row.gradient_steps / row.iterations:.1f}",
        f"{row.policy_solves / row.iterations:.1f}",
        f"{row.iteration_seconds:.3f}",
        f"{row.peak_memory:.0f}",
    ]


CLOSING_COLUMNS = (
    "",
    "CVR, last update",
    "SR, last update",
    "CVR, end",
    "SR, end",
    "distance of theta",
    "of omega",
    "of flights",
)


def closing_table(of: Sequence[Row]) -> list[list[str]]:
    """What the closing rounds change, a line a learner of a network, below ``CLOSING_COLUMNS``."""
    return [
        [
            f"{name_of(row)} ({row.group})",
            str(row.updated_violation_rate),
            str(row.updated_success_rate),
            str(row.violation_rate),
            str(row.success_rate),
            f"{row.consensus_theta.mean:.1e}",
            f"{row.consensus_omega.mean:.1e}",
            str(row.policy_distance),
        ]
        for row in of
        if row.learner.startswith("learner")
    ]


PILLAR_COLUMNS = ("pillar", "drone", "touching it", "its rim", "ways flown", "dearer")


def pillar_table(settings: DroneSettings, outcomes: Sequence[Outcome]) -> Iterator[list[str]]:
    """Learned costs of every pillar for every drone, over learners of MA-BIRDS and seeds, below ``PILLAR_COLUMNS``."""
    ones = [one for one in outcomes if one.label == MABIRDS]
    for pillar, circle in enumerate(settings.pillars):
        for drone in range(settings.n_experts):
            dear = [dear_pillars(one)[drone, pillar] for one in ones]
            yield [
                f"({circle.centre[0]:g}, {circle.centre[1]:g}) m",
                str(drone + 1),
                str(spread([one.pillar_inside[drone][pillar] for one in ones])),
                str(spread([one.pillar_rim[drone][pillar] for one in ones])),
                str(spread([one.flown[drone] for one in ones])),
                f"{sum(dear)} of {len(dear)}",
            ]
