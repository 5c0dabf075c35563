"""The player's alarm: never later than asked for, and left alone where it rings early enough."""

from collections.abc import Callable
from typing import Any

import pytest

from mabirds_expert_player.alarm import IDLE, NANOSECONDS, Alarm


class Clockwork:
    """A node with one timer, which rings over and over as rclpy's do."""

    def __init__(self) -> None:
        self.now, self.timer_period_ns, self.settings = 100.0, 0, 0
        self._since = self.now

    def create_timer(self, seconds: float, on_time: Callable[[], None]) -> "Clockwork":
        self.timer_period_ns, self.ring = int(seconds * NANOSECONDS), on_time
        return self

    def reset(self) -> None:
        self.settings, self._since = self.settings + 1, self.now

    @property
    def rings_at(self) -> float:
        return self._since + self.timer_period_ns / NANOSECONDS


@pytest.fixture
def node() -> Any:
    return Clockwork()


@pytest.fixture
def alarm(node: Any) -> Alarm:
    return Alarm(node, lambda: None)


def test_it_rings_when_it_is_to_and_for_a_later_time_before(node: Clockwork, alarm: Alarm) -> None:
    alarm.set(node.now, 0.5)
    assert node.rings_at == pytest.approx(100.5)
    node.now = 100.2
    alarm.set(node.now, 3.0)
    alarm.set(node.now, 0.3)  # the same time, but for rounding
    assert (node.rings_at, node.settings) == (pytest.approx(100.5), 1)
    alarm.set(node.now, 0.1)
    assert (node.rings_at, node.settings) == (pytest.approx(100.3), 2)


def test_once_it_has_rung_it_is_set_anew(node: Clockwork, alarm: Alarm) -> None:
    alarm.set(node.now, 0.5)
    node.now = 100.5
    alarm.set(node.now, 7.0)
    assert node.rings_at == pytest.approx(107.5)


def test_also_where_it_has_rung_a_little_early(node: Clockwork) -> None:
    rung = list[float]()
    alarm = Alarm(node, lambda: rung.append(node.now))
    alarm.set(node.now, 0.5)
    node.now = 100.4999
    node.ring()
    alarm.set(node.now, 0.0001)
    assert rung == [100.4999]
    assert node.rings_at == pytest.approx(100.5)


def test_what_is_due_now_rings_now_whenever_it_was_to_ring(node: Clockwork, alarm: Alarm) -> None:
    for _ in range(2):
        alarm.set(node.now, 0.0)
        assert node.timer_period_ns == 1
    assert node.settings == 2


def test_nobody_waits_longer_than_an_hour(node: Clockwork, alarm: Alarm) -> None:
    alarm.set(node.now, 1e12)
    assert node.rings_at == pytest.approx(100.0 + IDLE)
    node.now += 1.0
    alarm.set(node.now, IDLE)
    assert node.settings == 1
