"""Statuses that lie: the player skips nothing, sends nothing too early, and stays up."""

from collections.abc import Callable
from typing import Any

import pytest
from harness import NODES, few, sent_to
from hypothesis import given
from hypothesis import strategies as st
from junk import made_up, spoiled
from mabirds_msgs.msg import Demonstration, LearnerStatus
from truth import Truth

from mabirds_expert_player.stream import AckFilter, Stream
from mabirds_msgs_py.qos import STATUS_QOS, latched


class Learners:
    """Learners that take what they are sent in order, and the liar who speaks in their names."""

    def __init__(self, nodes: Any, truth: Truth) -> None:
        self.truth, self.node = truth, nodes.plain("learners")
        self.received: dict[str, list[int]] = {name: [] for name in truth.experiment.learners}
        self.learned = dict.fromkeys(truth.experiment.learners, 0)
        self._publishers = {}
        for name in truth.experiment.learners:
            self._publishers[name] = self.node.create_publisher(LearnerStatus, f"/{name}/status", STATUS_QOS)
            self.node.create_subscription(Demonstration, f"/{name}/demonstration", self._receive, latched(256))

    def _receive(self, message: Demonstration) -> None:
        name = message.learner
        self.received[name].append(message.iteration)
        if message.iteration == self.learned[name] + 1:
            self.learned[name] += 1
        self.tell(name)

    def tell(self, name: str, **lies: Any) -> None:
        waiting = LearnerStatus.WAITING_FOR_DEMONSTRATION
        truth = {"last_demonstration": self.learned[name], "state": waiting}
        self._publishers[name].publish(self.truth.status(name, **(truth | lies)))


@pytest.fixture
def long(make_truth: Callable[..., Truth]) -> Truth:
    return make_truth(iterations=20)


@pytest.mark.parametrize(
    ("lies", "text"),
    [
        ({"last_demonstration": 21}, "says that it learned 21 of 20; it is ignored, look for a second publisher"),
        ({"last_demonstration": 2**64 - 1}, "says that it learned 18446744073709551615 of 20; it is ignored"),
        ({"last_demonstration": 20}, "learner_1 says that it learned 20, which contradicts what was sent or said"),
        ({"learner": "learner_2"}, "a status on learner_1's topic is of 'learner_2' and says"),
        ({"learner": "\n\x1b[2J"}, r"a status on learner_1's topic is of '\n\x1b[2J' and says"),
        ({"game_digest": "g" * 100_000}, "learner_1 has another game: digest ggg"),
        ({"experiment_digest": "other"}, "learner_1 has another experiment: digest other, here"),
        ({"schedule_digest": ""}, "learner_1 has another schedule: digest , here"),
    ],
)
def test_a_lying_status_is_named_and_skips_nothing(
    nodes: Any, long: Truth, capfd: pytest.CaptureFixture[str], lies: dict[str, Any], text: str
) -> None:
    """Told before the truth, and again and again in between: every demonstration is sent, in order, none too early."""
    learners, player = Learners(nodes, long), nodes.player(long.file, hz=100.0, max_in_flight=4)
    learners.tell("learner_1", **lies)
    nodes.spin_for(0.3)
    assert learners.received["learner_1"] == []
    for name in long.experiment.learners:
        learners.tell(name)
    while not player.done:
        assert len(learners.received["learner_1"]) <= learners.learned["learner_1"] + 4
        learners.tell("learner_1", **lies)
        learners.tell("learner_1")
        nodes.spin_for(0.02)
    assert learners.received["learner_1"] == list(range(1, 21))
    output = "".join(capfd.readouterr())
    assert text in output
    assert len(output) < 10_000


@NODES
def test_a_player_survives_statuses_of_any_content(nodes: Any, long: Truth, count: int) -> None:
    player = nodes.player(long.file, hz=1e4, max_in_flight=4)

    @few(count * 10)
    @given(st.one_of(spoiled(lambda: long.status("learner_1")), made_up(LearnerStatus)))
    def check(status: LearnerStatus) -> None:
        sent_to(player, "/learner_1/status", status)
        assert player.playback.streams["learner_1"].sent <= 20

    check()


TICK = 0.1


class Liar:
    """A player's stream and a learner's truth in time of their own, with lies in between."""

    def __init__(self, total: int, max_in_flight: int) -> None:
        self.stream, self.claims = Stream(total, max_in_flight), AckFilter(2.0)
        self.learned, self.now = 0, 0.0
        self.arrived: set[int] = set()

    def hear(self, claim: int) -> None:
        believed = self.claims.accepted(claim, self.stream.sent, self.now)
        if believed is None:
            return
        self.stream.acknowledge(believed)
        self.arrived |= set(self.stream.missing(self.now, 2.0))
        while self.stream.open:
            self.arrived.add(self.stream.mark_sent(self.now, self.now, self.now, 0.0))

    def tick(self) -> None:
        """The learner learns what has arrived, and says so."""
        self.now += TICK
        if self.learned + 1 in self.arrived:
            self.learned += 1
        self.hear(self.learned)


@given(
    total=st.integers(1, 40),
    max_in_flight=st.integers(1, 8),
    lies=st.lists(st.lists(st.integers(0, 60), max_size=3), min_size=1, max_size=10),
)
def test_lies_beyond_what_was_sent_let_nothing_be_skipped_or_sent_too_early(
    total: int, max_in_flight: int, lies: list[list[int]]
) -> None:
    """The same lies are told again and again, as long as the learner has not learned everything."""
    world = Liar(total, max_in_flight)
    for turn in range(200 * total):
        if world.learned == total:
            break
        for lie in lies[turn % len(lies)]:
            world.hear(max(min(lie, total), world.stream.sent + 1))
            assert not world.stream.finished
        world.tick()
        assert world.stream.sent <= world.learned + max_in_flight
    assert world.learned == total


@given(
    total=st.integers(1, 20),
    max_in_flight=st.integers(1, 8),
    lies=st.lists(st.lists(st.integers(0, 20), max_size=3), min_size=1, max_size=10),
)
def test_no_lies_at_all_let_anything_be_lost(total: int, max_in_flight: int, lies: list[list[int]]) -> None:
    """They may make it slow, since what was skipped is sent again after some patience."""
    world = Liar(total, max_in_flight)
    for turn in range(1000):
        for lie in lies[turn % len(lies)]:
            world.hear(min(lie, total))
        world.tick()
        if world.learned == total:
            return
    for _ in range(100 * total):  # the liar is found
        world.tick()
    assert world.learned == total


def test_a_restarted_player_believes_a_learner_after_a_while() -> None:
    claims = AckFilter(patience=2.0)
    assert [claims.accepted(7, 0, now) for now in (10.0, 11.0, 11.9, 12.1)] == [None, None, None, 7]
    assert claims.accepted(7, 7, 12.2) == 7


def test_of_two_learners_of_one_name_the_slower_one_counts() -> None:
    claims = AckFilter(patience=2.0)
    said = [(5, 0.0), (2, 0.1), (6, 0.2), (3, 0.3), (6, 1.2), (3, 1.3)]
    assert [claims.accepted(number, 8, now) for number, now in said] == [5, 2, 2, 2, 2, 2]
    assert [claims.accepted(6, 8, now) for now in (2.5, 3.5, 3.6)] == [3, 6, 6], "the slower one has gone"
