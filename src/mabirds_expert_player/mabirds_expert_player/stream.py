"""Where one learner's stream stands: what is due, what is held back, what must be sent again. No ROS, no clock."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from math import inf


@dataclass
class Stream:
    """Demonstrations ``first`` to ``total`` of one learner.

    Lossless by construction: never more than ``max_in_flight`` demonstrations beyond ``acknowledged``, the newest one
    that the learner says it has learned. Where nobody learns, ``looked_at`` says whether to play to listeners.
    Due times are seconds of recorded time as it is played (``PlayClock``), sending times seconds of a steady clock.
    """

    total: int
    max_in_flight: int
    sent: int = 0
    acknowledged: int = 0
    ready: bool = False
    last_due: float | None = None
    last_sent_at: float = 0.0
    first: int = 1
    looked_at: bool = False
    at_once: int = 0
    """Up to this one demonstrations are due at once: what a learner needs before the place where playing began."""
    appointed: float | None = None
    """When the next one is due, after a seek."""

    @property
    def finished(self) -> bool:
        """Has the learner acknowledged everything, or has everything been sent to those who only look?"""
        return self.acknowledged >= self.total or (self.only_looked_at and self.sent >= self.total)

    @property
    def only_looked_at(self) -> bool:
        """Does nobody learn from it, and is it played to listeners?"""
        return self.looked_at and not self.ready

    @property
    def held_back(self) -> bool:
        """Is there something to send that the learner is not ready to take?"""
        return self.ready and self.sent < self.total and self.sent >= self.acknowledged + self.max_in_flight

    @property
    def supplied(self) -> bool:
        """Has the learner half of what it may have before it, or everything?"""
        return self.ready and (self.sent >= self.total or 2 * (self.sent - self.acknowledged) >= self.max_in_flight)

    @property
    def open(self) -> bool:
        """May the next demonstration be sent, as far as the learner is concerned?"""
        return (self.ready or self.looked_at) and self.sent < self.total and not self.held_back

    def acknowledge(self, iteration: int) -> None:
        """The learner has learned everything up to ``iteration``.

        Also where a player takes up after its own restart, and, where the number falls, after the learner's. A learner
        that is heard for the first time gets at once what was played, or left out, before.
        """
        if not self.ready:
            self.at_once, self.sent = max(self.at_once, self.sent, self.first - 1), 0
        self.ready = True
        self.acknowledged = min(iteration, self.total)
        self.sent = max(self.sent, self.acknowledged)

    def begin(self, first: int, total: int) -> None:
        """Play a part; a learner gets at once what it needs before it.

        Parameters
        ----------
        first : int
            Its first demonstration.
        total : int
            Its last one.
        """
        self.first, self.total, self.last_due, self.appointed = first, total, None, None
        self.jump(first)

    def jump(self, iteration: int, appointed: float | None = None) -> None:
        """Go on with a demonstration: listeners miss what is between, a learner gets it at once.

        Parameters
        ----------
        iteration : int
            The next one.
        appointed : float, optional
            When it is due; else as after the one before.
        """
        if self.ready:
            self.at_once = max(self.at_once, iteration - 1)
        else:
            self.sent = iteration - 1
        self.appointed = appointed

    def due_at(self, gap: Callable[[int], float]) -> float:
        """When the next demonstration is due; ``gap(n)``: recorded seconds between demonstrations n - 1 and n."""
        if self.sent < self.at_once or (self.last_due is None and self.appointed is None):
            return 0.0
        return self.appointed if self.appointed is not None else (self.last_due or 0.0) + gap(self.sent + 1)

    def mark_sent(self, now: float, due: float, at: float, tolerance: float) -> int:
        """Count the next demonstration as sent.

        A demonstration that was late because it was held back shifts the ones after it: no burst makes up for it.

        Parameters
        ----------
        now : float
            Recorded seconds played.
        due : float
            When the demonstration was, in these.
        at : float
            Seconds of the steady clock.
        tolerance : float
            Recorded seconds of lateness that are made up for.

        Returns
        -------
        int
            Its number.
        """
        late = (self.last_due is None and self.appointed is None) or now - due > tolerance
        if self.sent >= self.at_once:
            self.appointed = None
        self.last_due = now if late else due
        self.last_sent_at = at
        self.sent += 1
        return self.sent

    def missing(self, now: float, patience: float) -> range:
        """What was sent and is still not acknowledged by a learner that waits, after the last that is.

        By the last one a learner that was sent another in this name knows that this is the bag that it learned from.

        Parameters
        ----------
        now : float
            Seconds of the steady clock.
        patience : float
            Seconds since it was sent.

        Returns
        -------
        range
            Demonstrations to send again.
        """
        if self.sent <= self.acknowledged or now - self.last_sent_at < patience:
            return range(0)
        self.last_sent_at = now
        return range(max(self.acknowledged, 1), min(self.sent, self.acknowledged + self.max_in_flight) + 1)


@dataclass
class AckFilter:
    """How much one learner says it has learned, and how much of that is believed. Times as in ``Stream``.

    What is said may contradict what was said just before, by falling, or what was sent, by exceeding it. Either the
    learner or this player was started again, which is over after ``patience`` seconds, or somebody else speaks in the
    learner's name. Until it is over the least counts: nobody is left behind or skipped.
    """

    patience: float
    suspect_since: float | None = None
    _heard: deque[tuple[float, int]] = field(default_factory=deque)
    _fell_from: float = -inf
    """When what was said last before it fell was said."""

    def accepted(self, learned: int, sent: int, now: float) -> int | None:
        """How much of what a learner says counts.

        Parameters
        ----------
        learned : int
            Its number of the newest demonstration learned.
        sent : int
            Number of the newest one sent.
        now : float
            The present time.

        Returns
        -------
        int or None
            What counts now; None: nothing does yet.
        """
        if self._heard and learned < self._heard[-1][1]:
            self._fell_from = self._heard[-1][0]
        self._heard.append((now, learned))
        while now - self._heard[0][0] > self.patience:
            self._heard.popleft()
        if learned <= sent:
            self.suspect_since = None
        elif self.suspect_since is None:
            self.suspect_since = now
        if self.suspect_since is not None and now - self.suspect_since < self.patience:
            return min((number for _, number in self._heard if number <= sent), default=None)
        fell = now - self._fell_from <= self.patience
        return min(number for _, number in self._heard) if fell else learned


JITTER_TOLERANCE = 0.05
"""Seconds of lateness that ordinary timers have and that the following demonstrations make up for."""
