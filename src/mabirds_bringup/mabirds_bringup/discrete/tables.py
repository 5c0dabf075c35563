"""The benchmark's tables: means and half-widths over seeds, times scaled by the fastest."""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from mabirds_bringup.discrete.outcome import Outcome

SUCCESS_LEVELS = (0.5, 0.9)


@dataclass(frozen=True)
class Spread:
    """A mean over seeds and half the range around it."""

    mean: float
    half_width: float

    def __str__(self) -> str:
        return f"{self.mean:.3f} ± {self.half_width:.3f}"


def spread(values: Sequence[float]) -> Spread:
    """Mean and half of max - min."""
    return Spread(float(np.mean(values)), float(np.ptp(values)) / 2)


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
        return f"{self.label} {self.learner}" if self.learner.startswith("learner") else self.label


def rows(outcomes: Sequence[Outcome]) -> list[Row]:
    """One row a case and learner, in the order of the outcomes."""
    groups: dict[tuple[str, str, str], list[Outcome]] = {}
    for one in outcomes:
        groups.setdefault((one.group, one.label, one.learner), []).append(one)
    return [_row(ones) for ones in groups.values()]


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
        float(np.mean([one.seconds for one in ones])),
        tuple(_mean_time(ones, level) for level in SUCCESS_LEVELS),
        float(np.mean([one.gradient_steps for one in ones])),
        float(np.mean([one.policy_solves for one in ones])),
        len(first.seconds),
    )


def _mean_time(ones: list[Outcome], level: float) -> float | None:
    """Mean over seeds of the time until SR first reaches ``level``; None where a seed never does."""
    times = [time_to(one, level) for one in ones]
    known = [time for time in times if time is not None]
    return float(np.mean(known)) if len(known) == len(times) else None


def time_to(one: Outcome, level: float) -> float | None:
    """Seconds of updates until SR first is at least ``level``."""
    reached = np.flatnonzero(np.array(one.success_rate) >= level)
    return float(np.sum(one.seconds[: reached[0]])) if len(reached) else None


def scaled(values: Sequence[float | None], fastest: float) -> list[str]:
    """Times as multiples of the fastest."""
    return ["never" if value is None else f"{value / fastest:.3f}" for value in values]


COLUMNS = ("", "FPR", "FNR", "CVR", "SR", "STPOI", "50% ST", "90% ST", "gradient steps", "policy solves", "seconds")


def table(of: Sequence[Row]) -> list[list[str]]:
    """Tables 1 and 2 in one: a line a row, below ``COLUMNS``. STPOI: time an online iteration, scaled."""
    times = [[row.iteration_seconds, *row.seconds_to_level] for row in of]
    fastest = [min((time for time in column if time), default=1.0) for column in zip(*times, strict=True)]
    columns = [scaled(column, best) for column, best in zip(zip(*times, strict=True), fastest, strict=True)]
    return [
        [row.name, *_rates(row), *own_times, *_work(row)]
        for row, own_times in zip(of, zip(*columns, strict=True), strict=True)
    ]


def _rates(row: Row) -> Iterator[str]:
    rates = (row.false_positive_rate, row.false_negative_rate, row.violation_rate, row.success_rate)
    return (str(rate) for rate in rates)


def _work(row: Row) -> list[str]:
    return [
        f"{row.gradient_steps / row.iterations:.1f}",
        f"{row.policy_solves / row.iterations:.1f}",
        f"{row.iteration_seconds:.3f}",
    ]
