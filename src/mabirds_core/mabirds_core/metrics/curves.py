"""What a curve of rates over iterations says: how it ends, and from when on it stays where it is."""

from collections.abc import Sequence

LATE = 15
"""Iterations at the end that "late" means."""


def late_mean(rates: Sequence[float]) -> float:
    """Mean over the last LATE values."""
    late = rates[-LATE:]
    return sum(late) / len(late)


def late_minimum(rates: Sequence[float]) -> float:
    """Smallest of the last LATE values: one bad iterate shows."""
    return min(rates[-LATE:])


def first_at(rates: Sequence[float], level: float) -> int | None:
    """Index of the first value that is at least a level, as the paper counts.

    Parameters
    ----------
    rates : Sequence[float]
        One per iteration.
    level : float
        In [0, 1].

    Returns
    -------
    int or None
        None: never.

    Examples
    --------
    >>> first_at([0.1, 0.95, 0.2, 0.91, 0.93], 0.9)
    1
    """
    return next((index for index, rate in enumerate(rates) if rate >= level), None)


def stays_from(rates: Sequence[float], level: float) -> int | None:
    """Index from which on all values are at least a level.

    Parameters
    ----------
    rates : Sequence[float]
        One per iteration.
    level : float
        In [0, 1].

    Returns
    -------
    int or None
        None: never.

    Examples
    --------
    >>> stays_from([0.1, 0.95, 0.2, 0.91, 0.93], 0.9)
    3
    """
    below = [index for index, rate in enumerate(rates) if rate < level]
    start = below[-1] + 1 if below else 0
    return start if start < len(rates) else None
