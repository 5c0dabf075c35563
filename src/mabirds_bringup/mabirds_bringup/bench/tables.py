"""Tables of benchmarks: means and half-widths over seeds, times scaled by the fastest."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol, TypeVar

import numpy as np

SUCCESS_LEVELS = (0.5, 0.9)


class Timed(Protocol):
    """An outcome as times see it: success rates after k updates, and the seconds of each update."""

    @property
    def success_rate(self) -> list[float]:
        """Entry k: after k updates."""
        ...

    @property
    def seconds(self) -> list[float]:
        """Of each update."""
        ...


class Named(Protocol):
    """An outcome or a row of a table."""

    @property
    def group(self) -> str:
        """Of cases."""
        ...

    @property
    def label(self) -> str:
        """Of the case."""
        ...

    @property
    def learner(self) -> str:
        """The learner or central method."""
        ...


AnyNamed = TypeVar("AnyNamed", bound=Named)


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


def name_of(one: Named) -> str:
    """The case, and which of its learners."""
    return f"{one.label} {one.learner}" if one.learner.startswith("learner") else one.label


def by_learner(outcomes: Iterable[AnyNamed]) -> list[list[AnyNamed]]:
    """The outcomes of each case and learner, over the seeds, in the order in which they come first."""
    groups: dict[tuple[str, str, str], list[AnyNamed]] = {}
    for one in outcomes:
        groups.setdefault((one.group, one.label, one.learner), []).append(one)
    return list(groups.values())


def iteration_seconds(ones: Iterable[Timed]) -> float:
    """Mean over seeds of the seconds of an update."""
    return float(np.mean([one.seconds for one in ones]))


def times_to_levels(ones: Sequence[Timed]) -> tuple[float | None, ...]:
    """For each of SUCCESS_LEVELS the mean time over seeds; None where a seed never reaches it."""
    return tuple(_mean([time_to(one, level) for one in ones]) for level in SUCCESS_LEVELS)


def _mean(times: Sequence[float | None]) -> float | None:
    known = [time for time in times if time is not None]
    return float(np.mean(known)) if len(known) == len(times) else None


def time_to(one: Timed, level: float) -> float | None:
    """Seconds of updates until SR first is at least ``level``."""
    reached = np.flatnonzero(np.array(one.success_rate) >= level)
    return float(np.sum(one.seconds[: reached[0]])) if len(reached) else None


def scaled_lines(lines: Sequence[Sequence[float | None]]) -> list[list[str]]:
    """Lines of times, each column as multiples of its fastest."""
    columns = [
        scaled(column, min((time for time in column if time), default=1.0)) for column in zip(*lines, strict=True)
    ]
    return [list(line) for line in zip(*columns, strict=True)]


def scaled(values: Sequence[float | None], fastest: float) -> list[str]:
    """Times as multiples of the fastest."""
    return ["never" if value is None else f"{value / fastest:.3f}" for value in values]


def markdown_table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> Iterator[str]:
    """Lines of a table in Markdown."""
    yield f"| {' | '.join(header)} |"
    yield "|---" * len(header) + "|"
    yield from (f"| {' | '.join(line)} |" for line in lines)
