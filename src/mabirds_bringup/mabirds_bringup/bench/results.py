"""What the cases came to, as rows of numbers; without polars, which would count as memory of the cases' processes."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike


class MetricsRow(NamedTuple):
    """One number of a case, after ``iteration`` updates and closing rounds."""

    iteration: int
    metric: str
    value: float


@dataclass(frozen=True)
class CaseResult:
    """What one learner or central method of a case with one seed came to."""

    group: str
    label: str
    learner: str
    seed: int
    rows: list[MetricsRow]


def curve(metric: str, values: Sequence[float], first: int = 0) -> Iterator[MetricsRow]:
    """A metric at the iterations from ``first`` on, in order."""
    for iteration, value in enumerate(values, start=first):
        yield MetricsRow(iteration, metric, float(value))


def points(metric: str, values: Mapping[int, float]) -> Iterator[MetricsRow]:
    """A metric at some iterations."""
    for iteration, value in values.items():
        yield MetricsRow(iteration, metric, float(value))


def entries(iteration: int, **metrics: ArrayLike | Mapping[str, float]) -> Iterator[MetricsRow]:
    """Numbers, arrays and mappings at one iteration: entry (3, 1) of ``visits`` is the metric ``visits[3,1]``."""
    for name, values in metrics.items():
        if isinstance(values, Mapping):
            yield from (MetricsRow(iteration, f"{name}[{label}]", value) for label, value in values.items())
            continue
        for index, value in np.ndenumerate(np.asarray(values, dtype=np.float64)):
            place = f"[{','.join(map(str, index))}]" if index else ""
            yield MetricsRow(iteration, name + place, float(value))
