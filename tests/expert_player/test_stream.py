"""One learner's stream, without ROS and without a clock."""

from itertools import pairwise
from math import inf

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mabirds_expert_player.stream import JITTER_TOLERANCE, AckFilter, Stream


def constant(_: int) -> float:
    return 1.0


def play(stream: Stream, now: float) -> int:
    return stream.mark_sent(now, stream.due_at(constant), now, JITTER_TOLERANCE)


def test_nothing_is_open_before_the_learner_speaks() -> None:
    stream = Stream(total=5, max_in_flight=3)
    assert (stream.sent, stream.acknowledged, stream.open) == (0, 0, False)
    assert stream.due_at(constant) == 0.0, "at once"
    stream.acknowledge(0)
    assert stream.open


def test_never_more_than_the_window_ahead() -> None:
    stream = Stream(total=10, max_in_flight=3)
    stream.acknowledge(0)
    while stream.open:
        play(stream, now=100.0)
    assert (stream.sent, stream.held_back) == (3, True)
    stream.acknowledge(2)
    while stream.open:
        play(stream, now=200.0)
    assert stream.sent == 5


def test_a_learner_is_supplied_with_half_of_what_it_may_have_or_with_everything() -> None:
    stream = Stream(total=6, max_in_flight=4)
    assert not stream.supplied, "nobody learns"
    stream.acknowledge(0)
    supplied = list[bool]()
    while stream.open:
        supplied.append(stream.supplied)
        play(stream, 0.0)
    assert (supplied, stream.supplied) == ([False, False, True, True], True)
    stream.acknowledge(3)
    assert not stream.supplied
    play(stream, 1.0)
    play(stream, 2.0)
    stream.acknowledge(5)
    assert stream.supplied, "all is sent"


def test_it_is_finished_once_all_is_acknowledged_not_once_all_is_sent() -> None:
    stream = Stream(total=2, max_in_flight=5)
    stream.acknowledge(0)
    assert [play(stream, 0.0), play(stream, 1.0)] == [1, 2]
    assert (stream.finished, stream.held_back, stream.open) == (False, False, False)
    stream.acknowledge(2)
    assert stream.finished


def test_what_is_sent_in_full_is_not_held_back() -> None:
    stream = Stream(total=3, max_in_flight=3)
    stream.acknowledge(0)
    for now in (0.0, 1.0, 2.0):
        assert stream.open
        play(stream, now)
    assert (stream.held_back, stream.open) == (False, False)


def test_a_learner_that_begins_anew_gets_everything_again() -> None:
    stream = Stream(total=9, max_in_flight=3)
    stream.acknowledge(7)
    stream.acknowledge(0)
    assert stream.held_back
    assert list(stream.missing(now=9.0, patience=2.0)) == [1, 2, 3]


def test_a_restarted_player_takes_up_after_what_is_learned() -> None:
    stream = Stream(total=9, max_in_flight=3)
    stream.acknowledge(4)
    assert play(stream, 0.0) == 5


def test_small_lateness_is_made_up_for_and_long_delays_are_not() -> None:
    stream = Stream(total=9, max_in_flight=9)
    stream.acknowledge(0)
    play(stream, now=10.0)
    play(stream, now=11.0 + JITTER_TOLERANCE / 2)
    assert stream.due_at(constant) == 12.0
    play(stream, now=12.25)
    assert stream.due_at(constant) == 13.25


def test_a_demonstration_is_late_only_past_what_timers_have() -> None:
    stream = Stream(total=9, max_in_flight=9)
    stream.acknowledge(0)
    play(stream, now=-1.0)
    play(stream, now=JITTER_TOLERANCE)
    assert stream.due_at(constant) == 1.0


def test_demonstrations_are_as_far_apart_as_they_were_recorded() -> None:
    """gap(n) is the time between demonstrations n - 1 and n."""
    stream, gaps = Stream(total=9, max_in_flight=9), {2: 3.0, 3: 0.5, 4: 7.0}
    stream.acknowledge(0)
    stream.mark_sent(10.0, 10.0, 10.0, JITTER_TOLERANCE)
    found = []
    for number in gaps:
        due = stream.due_at(gaps.__getitem__)
        found.append(due)
        assert stream.mark_sent(due, due, due, JITTER_TOLERANCE) == number
    assert found == [13.0, 13.5, 20.5]


def test_what_a_waiting_learner_lacks_is_sent_again_after_patience() -> None:
    stream = Stream(total=9, max_in_flight=4)
    stream.acknowledge(0)
    for now in (0.0, 1.0, 2.0):
        play(stream, now)
    stream.acknowledge(1)
    assert list(stream.missing(now=3.0, patience=2.0)) == []
    assert list(stream.missing(now=4.5, patience=2.0)) == [1, 2, 3]
    assert list(stream.missing(now=5.0, patience=2.0)) == [], "patience starts anew"
    assert list(stream.missing(now=6.5, patience=2.0)) == [1, 2, 3], "patience is over"


def test_of_what_a_waiting_learner_lacks_no_more_is_sent_again_than_it_has_room_for() -> None:
    stream = Stream(total=9, max_in_flight=2)
    stream.acknowledge(0)
    assert list(stream.missing(now=9.0, patience=2.0)) == []
    stream.acknowledge(6)
    stream.acknowledge(3)
    assert list(stream.missing(now=2.0, patience=2.0)) == [3, 4, 5]
    stream.acknowledge(5)
    assert list(stream.missing(now=9.0, patience=2.0)) == [5, 6]
    stream.acknowledge(6)
    assert list(stream.missing(now=20.0, patience=2.0)) == []


@pytest.mark.parametrize("acknowledged", [99, 5])
def test_a_learner_cannot_acknowledge_more_than_there_is(acknowledged: int) -> None:
    stream = Stream(total=5, max_in_flight=3)
    stream.acknowledge(acknowledged)
    assert (stream.acknowledged, stream.sent, stream.finished) == (5, 5, True)


# What a learner says: (when, learned, sent) and what of it counts; patience is 2 s.
Claim = tuple[float, int, int, int | None]


@pytest.mark.parametrize(
    "claims",
    [
        pytest.param([(0.0, 0, 0, 0), (0.1, 1, 2, 1), (0.2, 4, 4, 4), (0.3, 4, 4, 4)], id="rising is believed at once"),
        pytest.param([(0.0, 5, 9, 5), (1.0, 2, 9, 2), (2.0, 5, 9, 2), (2.1, 5, 9, 5)], id="falling counts for 2 s"),
        pytest.param([(0.0, 5, 9, 5), (1.0, 2, 9, 2), (1.5, 3, 9, 2), (2.5, 3, 9, 3)], id="begun anew"),
        pytest.param([(0.0, 1, 9, 1), (5.0, 4, 9, 4), (5.5, 3, 9, 3), (9.0, 2, 9, 2)], id="long ago does not count"),
        pytest.param([(0.0, 7, 3, None), (1.0, 7, 3, None), (2.0, 7, 3, 7)], id="more than was sent"),
        pytest.param([(0.0, 3, 3, 3), (0.5, 4, 3, 3), (1.0, 4, 3, 3), (2.5, 4, 3, 4)], id="one more than was sent"),
        pytest.param([(0.0, 3, 4, 3), (0.5, 2, 4, 2), (1.0, 9, 4, 2), (1.5, 3, 4, 2)], id="the least of what can be"),
        pytest.param([(0.0, 7, 3, None), (1.0, 7, 7, 7), (2.5, 9, 8, 7), (4.5, 9, 8, 9)], id="each doubt takes 2 s"),
        pytest.param(
            [(0.0, 2, 3, 2), (1.0, 9, 3, 2), (2.0, 2, 3, 2), (3.0, 9, 3, 2), (4.0, 2, 3, 2), (5.0, 9, 3, 2)],
            id="a liar beside the learner is never believed",
        ),
    ],
)
def test_what_a_learner_says_it_has_learned_counts_unless_it_contradicts(claims: list[Claim]) -> None:
    speaker = AckFilter(patience=2.0)
    assert [(now, speaker.accepted(learned, sent, now)) for now, learned, sent, _ in claims] == [
        (now, expected) for now, _, _, expected in claims
    ]


def test_since_when_a_learner_is_doubted_is_known() -> None:
    speaker = AckFilter(patience=2.0)
    since = []
    for now, learned in [(1.0, 3), (2.0, 4), (3.0, 5), (4.0, 3), (5.0, 4)]:
        speaker.accepted(learned, sent=3, now=now)
        since.append(speaker.suspect_since)
    assert since == [None, 2.0, 2.0, None, 5.0]


said = st.lists(st.tuples(st.floats(0, 3), st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=20)


@given(said)
def test_nobody_is_taken_further_than_they_said_lately(claims: list[tuple[float, int, int]]) -> None:
    """And no further back than what they said in the last seconds."""
    speaker, now, heard = AckFilter(patience=2.0), 0.0, list[tuple[float, int]]()
    for gap, learned, sent in claims:
        now += gap
        heard.append((now, learned))
        lately = [number for when, number in heard if now - when <= 2.0]
        believed = speaker.accepted(learned, sent, now)
        assert believed in (None, learned, *lately)
        assert believed is None or believed <= learned or learned > sent


@given(said)
def test_what_counts_is_the_least_of_what_was_said_lately_where_it_fell(claims: list[tuple[float, int, int]]) -> None:
    """By all that was said in the last seconds, looked through at each claim."""
    speaker, now, since, heard = AckFilter(patience=2.0), 0.0, inf, list[tuple[float, int]]()
    for gap, learned, sent in claims:
        now += gap
        heard = [*((when, number) for when, number in heard if now - when <= 2.0), (now, learned)]
        lately, since = [number for _, number in heard], inf if learned <= sent else min(since, now)
        fell = any(later < before for before, later in pairwise(lately))
        expected = min(lately) if fell else learned
        if now - since < 2.0 and since < inf:
            expected = min((number for number in lately if number <= sent), default=None)
        assert speaker.accepted(learned, sent, now) == expected
