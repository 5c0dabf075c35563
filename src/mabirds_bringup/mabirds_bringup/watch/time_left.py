"""How long a run still takes, by the pace of its slowest learner since the first look."""

import time
from collections.abc import Callable, Sequence

LEAST = 2.0
"""Seconds of which a pace is taken at least."""


class TimeLeft:
    """Of a run of so many iterations; ``clock``: seconds that only grow."""

    def __init__(self, iterations: int, clock: Callable[[], float] = time.monotonic) -> None:
        self._iterations, self._clock = iterations, clock
        self._first: tuple[float, int] | None = None

    def words(self, learned: Sequence[int]) -> str:
        """Say it, by how many demonstrations each has ``learned``; empty while that cannot be told."""
        slowest, now = min(learned, default=0), self._clock()
        if not learned or slowest >= self._iterations:
            return ""
        since, before = self._first = self._first or (now, slowest)
        if slowest <= before or now - since < LEAST:
            return ""
        seconds = (self._iterations - slowest) * (now - since) / (slowest - before)
        return f"about {seconds:.0f} s left" if seconds < 120.0 else f"about {seconds / 60.0:.0f} min left"
