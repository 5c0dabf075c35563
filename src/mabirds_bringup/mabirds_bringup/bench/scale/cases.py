"""What is made larger, one thing at a time."""

from typing import NamedTuple

from mabirds_bringup.bench.solve.cases import SolveCase


class Sweep(NamedTuple):
    """Games of growing size.

    Attributes
    ----------
    name : str
        What grows.
    cases : dict[int, SolveCase]
        By size.
    at_most : float
        Limit on the exponent of time: that of the work there is, and .25 for what no longer fits into caches.
    """

    name: str
    cases: dict[int, SolveCase]
    at_most: float


def cells(sides: tuple[int, ...], horizon: int = 20) -> Sweep:
    """Two experts on larger maps: the joint states are the square of the cells."""
    return Sweep("cells", {side**2: SolveCase(side, 2, horizon) for side in sides}, 2.25)


def horizons(steps: tuple[int, ...], side: int = 8) -> Sweep:
    """A longer way on the same map."""
    return Sweep("horizon", {horizon: SolveCase(side, 2, horizon) for horizon in steps}, 1.25)


def experts(counts: tuple[int, ...], side: int = 4, horizon: int = 10) -> Sweep:
    """More experts on the same map, by the number of joint states.

    A state is then passed once for each expert, and where more of them could meet, more ways are counted one by one.
    """
    return Sweep("joint states", {side ** (2 * count): SolveCase(side, count, horizon) for count in counts}, 1.5)


SWEEPS = (cells((6, 8, 12, 16, 24)), horizons((10, 20, 40, 80, 160)), experts((2, 3, 4)))
SMALL_SWEEPS = (cells((4, 6, 8), 10), horizons((10, 20, 40), 5), experts((2, 3), 3))

LEARNERS, SMALL_LEARNERS = (2, 4, 8, 16, 32), (2, 4)
"""In a directed ring, where each hears one other."""

MOST_OF_LEARNERS = 0.25
"""Limit on the exponent of a learner's processor time in the number of learners: it hears no more of them."""
