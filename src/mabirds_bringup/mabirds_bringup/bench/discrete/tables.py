"""The benchmark's tables, a row a learner or method."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mabirds_bringup.bench.discrete.outcome import Outcome
from mabirds_bringup.bench.tables import (
    Spread,
    by_learner,
    iteration_seconds,
    name_of,
    scaled_lines,
    spread,
    times_to_levels,
)


@dataclass(frozen=True)
class Row:
    """One learner or method of one case, over all seeds. Times in seconds; None: a level that no seed reached."""

    group: str
    label: str
    learner: str
    false_positive_rate: Spread
    false_negative_rate: Spread
    violation_rate: Spread
    success_rate: Spread
    iteration_seconds: float
    seconds_to_level: tuple[float | None, ...]
    gradient_steps: float
    policy_solves: float
    iterations: int

    @property
    def name(self) -> str:
        """Case and learner."""
        return name_of(self)


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """One row a case and learner, in the order of the outcomes."""
    return [_row(ones) for ones in by_learner(outcomes)]


def _row(ones: list[Outcome]) -> Row:
    def over_seeds(value: Callable[[Outcome], float]) -> Spread:
        return spread([value(one) for one in ones])

    first = ones[0]
    return Row(
        first.group,
        first.label,
        first.learner,
        over_seeds(lambda one: one.false_positive_rate),
        over_seeds(lambda one: one.false_negative_rate),
        over_seeds(lambda one: one.violation_rate[-1]),
        over_seeds(lambda one: one.success_rate[-1]),
        iteration_seconds(ones),
        times_to_levels(ones),
        float(np.mean([one.gradient_steps for one in ones])),
        float(np.mean([one.policy_solves for one in ones])),
        len(first.seconds),
    )


COLUMNS = ("", "FPR", "FNR", "CVR", "SR", "STPOI", "50% ST", "90% ST", "gradient steps", "policy solves", "seconds")


def table(of: Sequence[Row]) -> list[list[str]]:
    """Tables 1 and 2 in one: a line a row, below ``COLUMNS``. STPOI: time an online iteration, scaled."""
    times = scaled_lines([[row.iteration_seconds, *row.seconds_to_level] for row in of])
    return [[row.name, *_rates(row), *own, *_work(row)] for row, own in zip(of, times, strict=True)]


def _rates(row: Row) -> Iterator[str]:
    rates = (row.false_positive_rate, row.false_negative_rate, row.violation_rate, row.success_rate)
    return (str(rate) for rate in rates)


def _work(row: Row) -> list[str]:
    return [
        f"{row.gradient_steps / row.iterations:.1f}",
        f"{row.policy_solves / row.iterations:.1f}",
        f"{row.iteration_seconds:.3f}",
    ]
