"""What is played when, without ROS and without a real clock."""

from collections import defaultdict
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mabirds_expert_player.playback import Part, Playback, PlaybackError
from mabirds_expert_player.stream import Stream

SECOND = 10**9


class Table:
    """A recording whose times are listed, in seconds after 1000 s."""

    def __init__(self, **times: list[float]) -> None:
        self._times = times

    def time(self, learner: str, iteration: int) -> int:
        assert iteration >= 1
        return round((1000 + self._times[learner][iteration - 1]) * SECOND)

    def count(self, learner: str) -> int:
        return len(self._times[learner])


def at(seconds: float) -> int:
    return round((1000 + seconds) * SECOND)


class Session:
    """A playback, and what it sends in simulated time."""

    def __init__(
        self, recording: Table, learners: tuple[str, ...] = ("a",), *, looked_at: bool = True, **options: object
    ) -> None:
        streams = {name: Stream(recording.count(name), 4, looked_at=looked_at) for name in learners}
        part = options.pop("part", Part())
        self.play = Playback(recording, streams, part, **options)  # type: ignore[arg-type]
        self.now, self.sent = 0.0, list[tuple[float, str, int]]()

    def run(self, seconds: float, step: float = 0.125) -> None:
        """Wake up often; exact in binary."""
        end = self.now + seconds
        while self.now < end:
            self.look()
            self.now += step
        self.look()

    def look(self) -> None:
        self.sent += [(self.now, *sent) for sent in self.play.due(self.now)]

    def numbers(self, learner: str = "a") -> list[int]:
        return [number for _, name, number in self.sent if name == learner]

    def times(self) -> list[float]:
        return [when for when, _, _ in self.sent]


EVEN = {"a": [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]}


@pytest.mark.parametrize("rate", [0.5, 1.0, 2.0, 4.0])
def test_demonstrations_come_as_they_were_recorded_at_a_rate(rate: float) -> None:
    session = Session(Table(a=[0.0, 1.0, 4.0, 6.0]))
    session.play.clock.set_rate(rate, 0.0)
    session.run(20.0)
    assert session.times() == [0.0, 1 / rate, 4 / rate, 6 / rate]
    assert session.play.finished


def test_a_new_rate_holds_at_once_and_what_was_waited_counts() -> None:
    session = Session(Table(a=[0.0, 8.0]))
    session.run(2.0)
    session.play.clock.set_rate(4.0, session.now)
    session.run(5.0)
    assert session.times() == [0.0, 2.0 + 6 / 4]


def test_a_pause_stops_the_recorded_time() -> None:
    session = Session(Table(**EVEN))
    session.run(1.5)
    session.play.clock.set_paused(True, session.now)
    session.run(10.0)
    assert session.times() == [0.0, 1.0]
    session.play.clock.set_paused(False, session.now)
    session.run(1.0)
    assert session.times() == [0.0, 1.0, 12.0]


def test_steps_come_in_the_order_of_the_recording() -> None:
    session = Session(Table(a=[0.0, 3.0, 4.0], b=[1.0, 2.0, 5.0]), ("a", "b"))
    session.play.clock.set_paused(True, 0.0)
    session.play.owed = 4
    session.look()
    assert [(name, number) for _, name, number in session.sent] == [("a", 1), ("b", 1), ("b", 2), ("a", 2)]
    assert session.play.owed == 0


def test_after_a_step_the_next_gap_is_waited_out() -> None:
    session = Session(Table(**EVEN))
    session.play.clock.set_paused(True, 0.0)
    session.run(3.0)
    session.play.owed = 2
    session.look()
    session.play.clock.set_paused(False, session.now)
    session.run(1.5)
    assert session.times() == [3.0, 3.0, 4.0]


def test_long_gaps_are_shortened() -> None:
    session = Session(Table(a=[0.0, 1.0, 40_000.0, 40_001.0]), max_gap=2.0)
    session.run(10.0)
    assert session.times() == [0.0, 1.0, 3.0, 4.0]


def test_what_is_due_next_and_where_it_is_is_known() -> None:
    session = Session(Table(a=[0.0, 10.0, 20.0]))
    session.play.clock.set_rate(2.0, 0.0)
    session.run(2.0)
    wait = session.play.next_wait(session.now)
    assert wait == (3.0, "a")
    assert session.play.position(session.now) == at(4.0)
    session.run(20.0)
    assert session.play.position(session.now) == at(20.0)


def test_hz_takes_the_place_of_the_recorded_timing() -> None:
    session = Session(Table(a=[0.0, 100.0, 101.0]))
    session.play.hz = 2.0
    session.run(3.0)
    assert session.times() == [0.0, 0.5, 1.0]


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (Part(at(2.0)), [3, 4, 5, 6]),
        (Part(at(1.5)), [3, 4, 5, 6]),
        (Part(end=at(2.5)), [1, 2, 3]),
        (Part(at(1.0), at(3.0)), [2, 3, 4]),
        (Part(iteration=5), [5, 6]),
        (Part(at(1.0), iteration=3), [3, 4, 5, 6]),
    ],
)
def test_a_part_is_what_listeners_get(part: Part, expected: list[int]) -> None:
    session = Session(Table(**EVEN), part=part)
    session.run(10.0)
    assert session.numbers() == expected
    assert session.play.finished


@pytest.mark.parametrize("part", [Part(at(6.0)), Part(end=at(-1.0)), Part(iteration=7), Part(at(3.0), at(2.0))])
def test_a_part_without_demonstrations_is_refused(part: Part) -> None:
    with pytest.raises(PlaybackError, match="nothing was recorded from .*; the recording begins at 1000.000 s"):
        Session(Table(**EVEN), part=part)


def test_a_learner_gets_what_it_needs_before_the_start_at_once() -> None:
    session = Session(Table(**EVEN), part=Part(iteration=4), looked_at=False)
    session.run(1.0)
    assert session.sent == []
    session.play.streams["a"].acknowledge(0)
    session.look()
    assert session.numbers() == [1, 2, 3]
    session.play.streams["a"].acknowledge(3)
    session.run(4.0)
    assert session.numbers() == [1, 2, 3, 4, 5, 6]
    assert session.times() == [1.0, 1.0, 1.0, 2.0, 3.0, 4.0]


def test_a_learner_that_comes_late_gets_at_once_what_was_played_to_listeners() -> None:
    session = Session(Table(**EVEN))
    session.run(2.5)
    assert session.numbers() == [1, 2, 3]
    session.play.streams["a"].acknowledge(0)
    session.look()
    assert session.numbers() == [1, 2, 3, 1, 2, 3]
    session.play.streams["a"].acknowledge(3)
    session.run(10.0)
    assert session.numbers() == [1, 2, 3, 1, 2, 3, 4, 5, 6]


def test_loops_are_for_listeners() -> None:
    session = Session(Table(a=[0.0, 1.0]), loops=3)
    session.run(10.0)
    assert session.numbers() == [1, 2] * 3
    assert session.play.finished
    learning = Session(Table(a=[0.0, 1.0]), loops=3, looked_at=False)
    learning.play.streams["a"].acknowledge(0)
    learning.run(10.0)
    assert learning.numbers() == [1, 2]
    assert not learning.play.finished
    learning.play.streams["a"].acknowledge(2)
    assert learning.play.finished


def test_without_end_it_goes_on() -> None:
    session = Session(Table(a=[0.0, 1.0]), loops=0)
    session.run(30.0)
    assert len(session.sent) > 20
    assert not session.play.finished


def test_listeners_may_be_taken_anywhere() -> None:
    session = Session(Table(**EVEN))
    session.run(3.5)
    session.play.seek(at(0.75), session.now)
    session.run(1.5)
    session.play.seek(at(5.0), session.now)
    session.run(1.0)
    assert session.numbers() == [1, 2, 3, 4, 2, 3, 6]
    assert session.times() == [0.0, 1.0, 2.0, 3.0, 3.75, 4.75, 5.0]


def test_a_seek_forward_gives_a_learner_everything_between_at_once() -> None:
    session = Session(Table(**EVEN), looked_at=False)
    session.play.streams["a"].acknowledge(0)
    session.look()
    session.play.streams["a"].acknowledge(1)
    session.play.seek(at(4.0), session.now)
    session.look()
    assert session.numbers() == [1, 2, 3, 4, 5]
    session.play.streams["a"].acknowledge(5)
    session.run(3.0)
    assert session.numbers() == [1, 2, 3, 4, 5, 6]
    assert session.times() == [0.0] * 5 + [1.0]


def test_what_is_learned_is_not_taken_back_and_nothing_changes() -> None:
    recording = Table(a=[0.0, 1.0, 2.0], b=[0.0, 1.0, 2.0])
    session = Session(recording, ("a", "b"))
    session.play.streams["b"].acknowledge(0)
    session.run(2.0)
    before = [(stream.sent, stream.at_once, stream.appointed) for stream in session.play.streams.values()]
    with pytest.raises(PlaybackError, match="b was given demonstrations up to 3 and learned 0: .* go back to 1"):
        session.play.seek(at(0.0), session.now)
    assert [(stream.sent, stream.at_once, stream.appointed) for stream in session.play.streams.values()] == before


@pytest.mark.parametrize("seconds", [-0.5, 5.5, -2000.0])
def test_a_seek_out_of_the_recording_is_refused(seconds: float) -> None:
    session = Session(Table(**EVEN))
    with pytest.raises(PlaybackError, match=r"is not in the recording, 1000\.000 s to 1005\.000 s"):
        session.play.seek(at(seconds), 0.0)


Order = Callable[[Session], None]


def _seek(seconds: float) -> Order:
    def order(session: Session) -> None:
        try:
            session.play.seek(at(seconds), session.now)
        except PlaybackError:
            return

    return order


def _learn(learner: str, share: float) -> Order:
    def order(session: Session) -> None:
        stream = session.play.streams[learner]
        stream.acknowledge(stream.acknowledged + round(share * (stream.sent - stream.acknowledged)))

    return order


def _step(count: int) -> Order:
    def order(session: Session) -> None:
        if session.play.clock.paused:
            session.play.owed = count

    return order


orders = st.one_of(
    st.floats(0, 9).map(lambda seconds: lambda session: session.run(seconds, 0.5)),
    st.sampled_from([0.01, 0.5, 1.0, 10.0, 1e9]).map(
        lambda rate: lambda session: session.play.clock.set_rate(rate, session.now)
    ),
    st.booleans().map(lambda paused: lambda session: session.play.clock.set_paused(paused, session.now)),
    st.integers(1, 9).map(_step),
    st.floats(-1, 41).map(_seek),
    st.tuples(st.sampled_from("ab"), st.floats(0, 1)).map(lambda pair: _learn(*pair)),
)


@given(st.lists(orders, max_size=40), st.integers(1, 25))
def test_whatever_is_asked_for_learners_get_everything_once_and_in_order(asked: list[Order], start: int) -> None:
    """And never more than they may have in flight: rates, pauses, steps and seeks change no bit of what is learned."""
    times = [2.0 * number for number in range(20)]
    recording = Table(a=times, b=[time + 0.5 for time in times])
    session = Session(recording, ("a", "b"), looked_at=False, part=Part(iteration=min(start, 20)))
    for stream in session.play.streams.values():
        stream.acknowledge(0)
    for order in asked:
        order(session)
        session.look()
        assert all(s.sent - s.acknowledged <= s.max_in_flight for s in session.play.streams.values())
    session.play.clock.set_rate(1e9, session.now)
    session.play.clock.set_paused(False, session.now)
    for _ in range(60):
        session.run(1.0, 0.5)
        _learn("a", 1.0)(session)
        _learn("b", 1.0)(session)
    received = defaultdict(list)
    for _, name, number in session.sent:
        received[name].append(number)
    assert received == {"a": list(range(1, 21)), "b": list(range(1, 21))}
    assert session.play.finished
