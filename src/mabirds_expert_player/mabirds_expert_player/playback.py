"""What is played when: several streams of one recording, one clock, and what people ask for. No ROS.

Learners decide what is lost: whoever learns gets every demonstration once and in order, so that rates, pauses, steps
and seeks change when the result is there, and no bit of it. Listeners that only look get what a bag player gives.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import NamedTuple, Protocol

from mabirds_core.errors import MabirdsError
from mabirds_expert_player.play_clock import ENDLESS, PlayClock
from mabirds_expert_player.stream import JITTER_TOLERANCE, Stream
from mabirds_msgs_py.conversion import NANOSECONDS

LONG_WAIT = 10.0
"""Seconds between two demonstrations from which on it is said that the recording has a gap."""

LONGEST = 1e12
"""Recorded seconds between two demonstrations at most, however slow hz asks for."""


class PlaybackError(MabirdsError):
    """Something was asked for that cannot be played."""


class Recording(Protocol):
    """Where demonstrations are from; ``DemonstrationBag`` is one."""

    def time(self, learner: str, iteration: int) -> int:
        """When a demonstration was recorded.

        Parameters
        ----------
        learner : str
            Its name.
        iteration : int
            Of the demonstration, from 1 on.

        Returns
        -------
        int
            Nanoseconds since the epoch.
        """

    def count(self, learner: str) -> int:
        """How many there are."""


@dataclass(frozen=True)
class Part:
    """Which part of a recording to play.

    Parameters
    ----------
    start : int
        Recorded nanoseconds since the epoch; demonstrations before are left out.
    end : int
        Demonstrations after are left out.
    iteration : int
        The first one, whatever its time.
    """

    start: int = 0
    end: int = 2**63 - 1
    iteration: int = 1


class Wait(NamedTuple):
    """Seconds of the steady clock until a learner's next demonstration is due."""

    seconds: float
    learner: str


class Playback:
    """Streams that are played together.

    Parameters
    ----------
    recording : Recording
        Of all learners.
    streams : Mapping[str, Stream]
        By learner.
    part : Part
        What to play.
    loops : int
        How often streams that nobody learns from are played; 0: without end.
    max_gap : float
        Recorded seconds to which longer pauses between demonstrations are shortened.
    """

    def __init__(
        self, recording: Recording, streams: Mapping[str, Stream], part: Part, loops: int = 1, max_gap: float = ENDLESS
    ) -> None:
        self.recording, self.streams = recording, streams
        self.clock = PlayClock()
        self.hz, self.loops, self.loop, self.max_gap = 0.0, loops, 1, max_gap
        self.stopped, self.owed, self.not_before = False, 0, 0.0
        self._totals = {learner: stream.total for learner, stream in streams.items()}
        self.play(part)

    @property
    def beginning(self) -> int:
        """Recording time of the first demonstration, nanoseconds since the epoch."""
        return min(self.recording.time(learner, 1) for learner in self.streams)

    @property
    def span(self) -> tuple[int, int]:
        """Recording times of the first and the last demonstration that are played."""
        played = [(learner, stream) for learner, stream in self.streams.items() if stream.first <= stream.total]
        times = [self.recording.time(learner, n) for learner, stream in played for n in (stream.first, stream.total)]
        return min(times), max(times)

    @property
    def finished(self) -> bool:
        """Is there nothing more to play?"""
        return self.stopped or (all(stream.finished for stream in self.streams.values()) and not self._loops_again)

    @property
    def supplied(self) -> bool:
        """Do all learners have enough before them, and is nothing asked for?"""
        return not self.owed and all(stream.supplied for stream in self.streams.values())

    @property
    def _loops_again(self) -> bool:
        looked_at = any(stream.only_looked_at for stream in self.streams.values())
        return looked_at and (self.loops == 0 or self.loop < self.loops)

    def play(self, part: Part) -> None:
        """Begin with a part.

        Parameters
        ----------
        part : Part
            Of the recording.

        Raises
        ------
        PlaybackError
            There is no demonstration in it.
        """
        extents = {learner: self._extent(learner, part) for learner in self.streams}
        if all(first > last for first, last in extents.values()):
            raise PlaybackError(
                f"nothing was recorded from {seconds(part.start)} and demonstration {part.iteration} on, until"
                f" {seconds(part.end)}; the recording begins at {seconds(self.beginning)}; play another part"
            )
        self.stopped, self.loop = False, 1
        for learner, (first, last) in extents.items():
            self.streams[learner].begin(first, last)

    def _extent(self, learner: str, part: Part) -> tuple[int, int]:
        numbers = range(part.iteration, self._totals[learner] + 1)
        first = self._first_since(learner, part.start, numbers)
        last = next((n for n in reversed(numbers) if self.recording.time(learner, n) <= part.end), 0)
        return first, max(last, 0)

    def _first_since(self, learner: str, time: int, numbers: range) -> int:
        """The first of these demonstrations at or after a time; one more than there are if none is."""
        return next((n for n in numbers if self.recording.time(learner, n) >= time), numbers.stop)

    def due(self, now: float) -> Iterator[tuple[str, int]]:
        """Demonstrations to send now; each counts as sent once it is given.

        Parameters
        ----------
        now : float
            Seconds of the steady clock.

        Yields
        ------
        tuple[str, int]
            Learner and iteration.
        """
        if self.stopped or now < self.not_before:
            return
        yield from self._owed_to(now)
        for learner, stream in self.streams.items():
            while not self.clock.paused and stream.open and self._due(learner) <= self.clock.read(now):
                yield learner, self._mark(stream, self._due(learner), now)
        if self._loops_again and all(stream.sent >= stream.total for stream in self.streams.values()):
            self._rewind()

    def _owed_to(self, now: float) -> Iterator[tuple[str, int]]:
        """What was asked for by step while paused, in the order of the recording as far as learners take it."""
        while self.owed and (learner := self._next_recorded()):
            self.owed -= 1
            yield learner, self._mark(self.streams[learner], self.clock.read(now), now)

    def _next_recorded(self) -> str | None:
        waiting = [learner for learner, stream in self.streams.items() if stream.open]
        return min(waiting, key=lambda name: self.recording.time(name, self.streams[name].sent + 1), default=None)

    def _mark(self, stream: Stream, due: float, now: float) -> int:
        return stream.mark_sent(self.clock.read(now), due, now, JITTER_TOLERANCE * self.clock.rate)

    def _rewind(self) -> None:
        self.loop += 1
        for stream in self.streams.values():
            if stream.only_looked_at:
                stream.jump(stream.first)

    def _due(self, learner: str) -> float:
        return self.streams[learner].due_at(partial(self.gap, learner))

    def gap(self, learner: str, iteration: int) -> float:
        """The pause before a demonstration, as it is played.

        Parameters
        ----------
        learner : str
            Whose.
        iteration : int
            Of the demonstration.

        Returns
        -------
        float
            Recorded seconds after the one before.
        """
        if self.hz > 0:
            return min(self.clock.rate / self.hz, LONGEST)
        if iteration <= 1:
            return 0.0
        recorded = self.recording.time(learner, iteration) - self.recording.time(learner, iteration - 1)
        return min(max(0, recorded) / NANOSECONDS, self.max_gap)

    def next_wait(self, now: float) -> Wait | None:
        """What is due next, of what learners would take; None while paused or where nothing would be taken."""
        if self.stopped or self.clock.paused:
            return None
        start = max(0.0, self.not_before - now)
        waits = [
            Wait(max(start, self.clock.until(self._due(learner), now)), learner)
            for learner, stream in self.streams.items()
            if stream.open
        ]
        return min(waits, default=None)

    def position(self, now: float) -> int:
        """Recording time that playing has come to: of the next demonstration, less what is left until it is due.

        Parameters
        ----------
        now : float
            Seconds of the steady clock.

        Returns
        -------
        int
            Nanoseconds since the epoch.
        """
        places = [
            self._position(learner, stream, now)
            for learner, stream in self.streams.items()
            if stream.sent < stream.total
        ]
        return min(places) if places else self.span[1]

    def _position(self, learner: str, stream: Stream, now: float) -> int:
        following = max(stream.sent + 1, stream.first)
        time = self.recording.time(learner, following)
        if stream.last_due is None and stream.appointed is None:
            return time
        left = max(0.0, min(self._due(learner) - self.clock.read(now), self.gap(learner, following)))
        return time - int(left * NANOSECONDS)

    def seek(self, time: int, now: float) -> str:
        """Go on with what was recorded at a time or later.

        Parameters
        ----------
        time : int
            Nanoseconds since the epoch.
        now : float
            Seconds of the steady clock.

        Returns
        -------
        str
            Where each stream goes on, in words.

        Raises
        ------
        PlaybackError
            Nothing was recorded there, or a learner was given what follows; nothing has changed then.
        """
        first, last = self.span
        if not first <= time <= last:
            raise PlaybackError(f"{seconds(time)} is not in the recording, {seconds(first)} to {seconds(last)}")
        targets = {
            learner: self._first_since(learner, time, range(stream.first, stream.total + 1))
            for learner, stream in self.streams.items()
        }
        self._refuse_unlearning(targets)
        for learner, target in targets.items():
            self._jump(learner, target, time, now)
        self.owed = 0
        return ", ".join(f"{learner} at {target}" for learner, target in targets.items())

    def _refuse_unlearning(self, targets: Mapping[str, int]) -> None:
        for learner, target in targets.items():
            stream = self.streams[learner]
            given = max(stream.sent, stream.acknowledged)
            if stream.ready and target <= given:
                raise PlaybackError(
                    f"{learner} was given demonstrations up to {given} and learned {stream.acknowledged}: what is"
                    f" learned cannot be taken back, so it cannot go back to {target}; start the learners anew, or look"
                    " with listeners alone"
                )

    def _jump(self, learner: str, target: int, time: int, now: float) -> None:
        stream = self.streams[learner]
        if target > stream.total:
            stream.jump(target)
            return
        wait = 0.0 if self.hz > 0 else (self.recording.time(learner, target) - time) / NANOSECONDS
        stream.jump(target, self.clock.read(now) + min(wait, self.max_gap))


def seconds(time: int) -> str:
    """Nanoseconds since the epoch as seconds, for people."""
    return f"{time / NANOSECONDS:.3f} s"
