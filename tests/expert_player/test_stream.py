"""One learner's stream, without ROS and without a clock."""

import pytest

from mabirds_expert_player.stream import LATENESS, Stream


def constant(_: int) -> float:
    return 1.0


def play(stream: Stream, now: float) -> int:
    return stream.mark_sent(now, stream.due_at(constant))


def test_nothing_is_open_before_the_learner_speaks() -> None:
    stream = Stream(total=5, window=3)
    assert not stream.open
    stream.acknowledge(0)
    assert stream.open


def test_never_more_than_the_window_ahead() -> None:
    stream = Stream(total=10, window=3)
    stream.acknowledge(0)
    while stream.open:
        play(stream, now=100.0)
    assert (stream.sent, stream.held_back) == (3, True)
    stream.acknowledge(2)
    while stream.open:
        play(stream, now=200.0)
    assert stream.sent == 5


def test_it_is_finished_once_all_is_acknowledged_not_once_all_is_sent() -> None:
    stream = Stream(total=2, window=5)
    stream.acknowledge(0)
    assert [play(stream, 0.0), play(stream, 1.0)] == [1, 2]
    assert not stream.finished
    assert not stream.held_back
    stream.acknowledge(2)
    assert stream.finished


def test_a_learner_that_begins_anew_gets_everything_again() -> None:
    stream = Stream(total=9, window=3)
    stream.acknowledge(7)
    stream.acknowledge(0)
    assert stream.held_back
    assert list(stream.missing(now=9.0, patience=2.0)) == [1, 2, 3]


def test_a_restarted_player_takes_up_after_what_is_learned() -> None:
    stream = Stream(total=9, window=3)
    stream.acknowledge(4)
    assert play(stream, 0.0) == 5


def test_small_lateness_is_made_up_for_and_long_delays_are_not() -> None:
    stream = Stream(total=9, window=9)
    stream.acknowledge(0)
    play(stream, now=10.0)
    play(stream, now=11.0 + LATENESS / 2)
    assert stream.due_at(constant) == 12.0
    play(stream, now=20.0)
    assert stream.due_at(constant) == 21.0


def test_what_a_waiting_learner_lacks_is_sent_again_after_patience() -> None:
    stream = Stream(total=9, window=4)
    stream.acknowledge(0)
    for now in (0.0, 1.0, 2.0):
        play(stream, now)
    stream.acknowledge(1)
    assert list(stream.missing(now=3.0, patience=2.0)) == []
    assert list(stream.missing(now=4.5, patience=2.0)) == [2, 3]
    assert list(stream.missing(now=5.0, patience=2.0)) == [], "patience starts anew"


@pytest.mark.parametrize("acknowledged", [99, 5])
def test_a_learner_cannot_acknowledge_more_than_there_is(acknowledged: int) -> None:
    stream = Stream(total=5, window=3)
    stream.acknowledge(acknowledged)
    assert (stream.acknowledged, stream.sent, stream.finished) == (5, 5, True)
