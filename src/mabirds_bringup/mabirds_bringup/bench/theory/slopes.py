"""Exponents of power laws: slopes in log-log axes over bins of equal ratio, with Student's intervals over seeds."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector

BINS_PER_DECADE = 10
CONFIDENCE = 0.95


class Interval(NamedTuple):
    """A mean and half the width of its 95 % confidence interval; infinite where there is one value."""

    mean: float
    half_width: float


def bins(last: int, per_decade: int = BINS_PER_DECADE) -> list[Indices]:
    """Iterations 1..last in bins (r^k, r^(k+1)] of one ratio r; bins without an iteration are left out.

    A power law's means over them are a power law again, whatever its exponent, as far as they are whole.
    """
    numbers = np.arange(1, last + 1)
    # Rounded, so that 10^k ends a bin and does not begin the next.
    bin_of = np.ceil(np.round(per_decade * np.log10(numbers), 9))
    return [numbers[bin_of == k] for k in np.unique(bin_of)]


def bin_means(values: Vector, per_decade: int = BINS_PER_DECADE) -> dict[int, float]:
    """Means of the values of iterations 1, 2, ... over each bin, by the bin's last iteration; nan does not count."""
    means = {int(of[-1]): values[of - 1] for of in bins(len(values), per_decade)}
    return {last: float(np.nanmean(of)) for last, of in means.items() if not np.isnan(of).all()}


def slope(iterations: Array, values: Array) -> float:
    """Least squares of log value = a + slope log n.

    >>> round(slope(np.array([1.0, 10.0, 100.0]), np.array([3.0, 0.3, 0.03])), 9)
    -1.0
    """
    x, y = np.log(iterations), np.log(values)
    x = x - x.mean()
    return float(x @ y / (x @ x))


def interval(values: Sequence[float], confidence: float = CONFIDENCE) -> Interval:
    """Student's interval of the mean of independent values."""
    from scipy.stats import t  # takes a second to load

    if len(values) == 1:
        return Interval(values[0], float("inf"))
    error = float(np.std(values, ddof=1)) / np.sqrt(len(values))
    return Interval(float(np.mean(values)), float(t.ppf((1 + confidence) / 2, len(values) - 1) * error))
