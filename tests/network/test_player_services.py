"""rosbag2's eleven services: each answers truthfully and says why; seeks, options, the log."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Duration, Time
from mabirds_msgs.msg import Demonstration, PlayerStatus
from pretend_learners import PretendLearners
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import load_experiment
from mabirds_expert_player.player_node import ExpertPlayerNode
from mabirds_expert_player.recorder import FIRST_STAMP
from mabirds_msgs_py.conversion import NANOSECONDS, time_message
from mabirds_msgs_py.player_services import PLAYER_SERVICES, service_type
from mabirds_msgs_py.qos import STATUS_QOS, latched

ROSBAG2 = {
    "Burst": ({"num_messages": "uint64"}, {"actually_burst": "uint64"}),
    "GetRate": ({}, {"rate": "double"}),
    "IsPaused": ({}, {"paused": "boolean"}),
    "Pause": ({}, {}),
    "Play": (
        {
            "start_offset": "builtin_interfaces/Time",
            "playback_duration": "builtin_interfaces/Duration",
            "playback_until_timestamp": "builtin_interfaces/Time",
        },
        {"success": "boolean"},
    ),
    "PlayNext": ({}, {"success": "boolean"}),
    "Resume": ({}, {}),
    "Seek": ({"time": "builtin_interfaces/Time"}, {"success": "boolean"}),
    "SetRate": ({"rate": "double"}, {"success": "boolean"}),
    "Stop": ({}, {}),
    "TogglePaused": ({}, {}),
}
"""Requests and responses as rosbag2_interfaces of ROS 2 Jazzy has them."""


class Player:
    """A player at which ``learner_1`` listens, and a person who calls its services."""

    def __init__(self, nodes: Any, file: Path, **parameters: Any) -> None:
        self.nodes, self.node = nodes, nodes.plain("person")
        self.heard: dict[str, list[int]] = {"learner_1": [], "learner_2": []}
        for name in self.heard:
            self.node.create_subscription(Demonstration, f"/{name}/demonstration", self._hear, latched(256))
        self.statuses: list[PlayerStatus] = []
        self.node.create_subscription(PlayerStatus, "/expert_player/player_status", self.statuses.append, STATUS_QOS)
        self.player: ExpertPlayerNode = nodes.player(file, **parameters)

    def _hear(self, message: Demonstration) -> None:
        self.heard[message.learner].append(message.iteration)

    def call(self, name: str, **fields: Any) -> Any:
        kind = service_type(name)
        client = self.node.create_client(kind, f"/expert_player/{name}")
        return self.nodes.call(client, kind.Request(**fields))

    def until(self, condition: Callable[[], Any]) -> None:
        self.nodes.spin_until(condition)


@pytest.fixture
def file(make_experiment: Callable[..., Path]) -> Path:
    return make_experiment(iterations=30)


def moment(seconds: float) -> Time:
    """After the first demonstration; they are a second apart."""
    return time_message(FIRST_STAMP + round(seconds * NANOSECONDS))


@pytest.mark.parametrize("kind", ROSBAG2)
def test_the_types_are_those_of_rosbag2(kind: str) -> None:
    request, response = ROSBAG2[kind]
    (name,) = [name for name, known in PLAYER_SERVICES.items() if known == kind]
    found = service_type(name, "mabirds_msgs")
    assert found.Request.get_fields_and_field_types() == request
    assert found.Response.get_fields_and_field_types() == response


def test_pause_resume_toggle_and_is_paused(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, hz=20.0)
    person.until(lambda: len(person.heard["learner_1"]) > 2)
    person.call("pause")
    assert person.call("is_paused").paused
    nodes.spin_for(0.2)
    count = len(person.heard["learner_1"])
    nodes.spin_for(0.3)
    assert len(person.heard["learner_1"]) == count
    person.call("pause")
    assert person.player.answer == "paused already"
    person.call("resume")
    assert not person.call("is_paused").paused
    person.until(lambda: len(person.heard["learner_1"]) > count + 1)
    person.call("toggle_paused")
    assert person.call("is_paused").paused
    person.call("toggle_paused")
    assert not person.call("is_paused").paused


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan"), 1e30])
def test_a_rate_that_is_none_is_refused_with_a_reason(nodes: Any, file: Path, rate: float) -> None:
    person = Player(nodes, file, rate=3)
    assert not person.call("set_rate", rate=rate).success
    assert "rate" in person.player.answer
    assert person.call("get_rate").rate == 3.0


def test_set_rate_holds_at_once_and_takes_the_place_of_hz(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, hz=0.01)
    person.until(lambda: person.heard["learner_1"] == [1])
    assert person.call("set_rate", rate=100.0).success
    assert person.call("get_rate").rate == 100.0
    person.until(lambda: len(person.heard["learner_1"]) == 30)
    assert person.heard["learner_1"] == list(range(1, 31))


def test_play_next_gives_one_in_recorded_order(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, start_paused=True)
    for _ in range(3):
        assert person.call("play_next").success
    person.until(lambda: person.heard == {"learner_1": [1, 2], "learner_2": [1]})
    person.call("resume")
    assert not person.call("play_next").success
    assert person.player.answer == "no step: it is playing; pause it first"


def test_a_step_without_anybody_says_for_whom_it_waits(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, start_paused=True)
    assert not person.call("play_next").success
    assert person.player.answer == ("no step: nothing heard of learner_1, learner_2; start it, or play to listeners")


def test_a_burst_goes_on_as_learners_learn_and_tells_how_many(nodes: Any, file: Path) -> None:
    """Asked for 24, with 4 in flight; the learners acknowledge what they get."""
    person = Player(nodes, file, max_in_flight=4, start_paused=True)
    learners = PretendLearners(nodes, load_experiment(file))
    for name in learners.received.keys() | {"learner_1", "learner_2"}:
        learners.acknowledge(name, 0)
    person.until(lambda: all(stream.ready for stream in person.player.playback.streams.values()))
    kind = service_type("burst")
    client = person.node.create_client(kind, "/expert_player/burst")
    nodes.spin_until(client.service_is_ready)
    future = client.call_async(kind.Request(num_messages=24))

    def learned() -> bool:
        for name, numbers in learners.received.items():
            learners.acknowledge(name, max(numbers, default=0))
        return bool(future.done())

    nodes.spin_until(learned)
    assert future.result().actually_burst == 24
    nodes.spin_until(lambda: sum(map(len, learners.received.values())) == 24)
    for name in ("learner_1", "learner_2"):
        assert learners.received[name] == list(range(1, 13))


def test_a_burst_past_the_end_tells_what_there_was(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, start_paused=True, stay=True)
    assert person.call("burst", num_messages=1000).actually_burst == 60
    assert person.player.answer == "published 60 of 1000: everything was played"
    assert person.call("burst", num_messages=1).actually_burst == 0
    assert person.player.answer == "no step: everything was played"


def test_a_burst_that_is_interrupted_tells_so(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, max_in_flight=4, start_paused=True, hz=1e-6)
    learners = PretendLearners(nodes, load_experiment(file))
    learners.acknowledge("learner_1", 0)
    person.until(lambda: person.player.playback.streams["learner_1"].ready)
    kind = service_type("burst")
    client = person.node.create_client(kind, "/expert_player/burst")
    nodes.spin_until(client.service_is_ready)
    future = client.call_async(kind.Request(num_messages=10))
    nodes.spin_until(lambda: learners.received["learner_1"] == [1, 2, 3, 4])
    person.call("resume")
    nodes.spin_until(future.done)
    assert future.result().actually_burst == 4
    assert person.player.answer == "published 4 of 10: it was resumed"


def test_listeners_are_taken_back_and_learners_are_not(nodes: Any, file: Path) -> None:
    """learner_1 only looks; somebody learns as learner_2, from the middle on."""
    person = Player(nodes, file, listeners=True, start_paused=True)
    assert person.call("burst", num_messages=10).actually_burst == 10
    assert person.call("seek", time=moment(1.0)).success
    assert person.player.answer == "seek to 1700000001.000 s: learner_1 at 2, learner_2 at 2"
    assert person.call("burst", num_messages=2).actually_burst == 2
    person.until(lambda: person.heard["learner_1"] == [1, 2, 3, 4, 5, 2])
    learners = PretendLearners(nodes, load_experiment(file))
    learners.acknowledge("learner_2", 0)
    person.until(lambda: person.player.playback.streams["learner_2"].ready)
    person.call("burst", num_messages=4)
    assert not person.call("seek", time=moment(0.0)).success
    assert "no seek: learner_2 was given demonstrations up to" in person.player.answer
    assert "what is learned cannot be taken back" in person.player.answer
    assert person.call("seek", time=moment(20.0)).success
    learners.acknowledge("learner_2", person.player.playback.streams["learner_2"].sent)
    person.until(lambda: person.player.playback.streams["learner_2"].acknowledged > 0)
    person.call("set_rate", rate=1e9)
    person.call("resume")

    def learned() -> bool:
        learners.acknowledge("learner_2", max(learners.received["learner_2"], default=0))
        return person.player.done

    nodes.spin_until(learned)
    assert sorted(set(learners.received["learner_2"])) == list(range(1, 31))
    assert person.heard["learner_1"][-10:] == list(range(21, 31)), "what is between is not for those who look"


def test_a_seek_out_of_the_recording_is_refused(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, start_paused=True)
    assert not person.call("seek", time=Time(sec=5)).success
    assert "5.000 s is not in the recording" in person.player.answer


def test_stop_ends_it_and_play_begins_a_part_where_it_stays(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, start_paused=True, stay=True, rate=1e6)
    assert not person.call("play").success
    assert person.player.answer == "no play: it is playing; stop it first"
    person.call("stop")
    assert person.player.answer == "stopped"
    assert not person.player.done
    person.call("resume")
    assert person.call("play", start_offset=Time(sec=2), playback_duration=Duration(sec=3)).success
    person.until(lambda: person.heard["learner_1"] == [3, 4, 5, 6])
    nodes.spin_for(0.2)
    assert person.call("play", start_offset=Time(sec=27)).success
    person.until(lambda: person.heard["learner_1"] == [3, 4, 5, 6, 28, 29, 30])
    assert not person.call("play", start_offset=Time(sec=100)).success
    assert "nothing was recorded" in person.player.answer


def test_stop_ends_the_node(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, hz=1.0)
    person.call("stop")
    assert person.player.done


def test_the_status_tells_where_it_is(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, start_paused=True, rate=2)
    person.call("burst", num_messages=7)
    person.until(lambda: person.statuses and person.statuses[-1].answer == "published 7")
    status = person.statuses[-1]
    assert (list(status.sent), list(status.total), list(status.consumes)) == ([4, 3], [30, 30], [False, False])
    assert (status.paused, status.playing, status.rate) == (True, True, 2.0)
    assert (status.first, status.last) == (moment(0), moment(29))
    assert moment(2) == status.at


def test_learners_are_included_and_excluded(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, include=["learner_[12]"], exclude=["learner_2"], rate=1e9)
    person.until(lambda: person.player.done)
    nodes.spin_for(0.2)
    assert person.heard == {"learner_1": list(range(1, 31)), "learner_2": []}
    for given, words in (
        ({"include": ["nobody"]}, "include 'nobody': matches none of learner_1, learner_2"),
        ({"exclude": ["("]}, "exclude '(': is no regular expression"),
        ({"exclude": ["learner_.*"]}, "include and exclude leave no learner"),
    ):
        with pytest.raises(ExperimentError) as refused:
            nodes.player(file, **given)
        assert words in str(refused.value)


def test_a_part_and_loops_are_played(nodes: Any, file: Path) -> None:
    person = Player(
        nodes, file, listeners=True, start_offset=1, playback_until=3, loop=2, rate=1e9, wait_for_all_acked=5.0
    )
    person.until(lambda: person.player.done)
    person.until(lambda: person.heard["learner_1"] == [2, 3, 4, 2, 3, 4])


def test_a_delay_is_waited(nodes: Any, file: Path) -> None:
    person = Player(nodes, file, listeners=True, delay=0.6, rate=1e9)
    nodes.spin_for(0.4)
    assert person.heard["learner_1"] == []
    person.until(lambda: len(person.heard["learner_1"]) == 30)


def test_recorded_time_goes_to_the_clock(nodes: Any, file: Path) -> None:
    times: list[int] = []
    node = nodes.plain("watch")
    node.create_subscription(Clock, "/clock", lambda m: times.append(m.clock.sec * NANOSECONDS + m.clock.nanosec), 10)
    Player(nodes, file, listeners=True, rate=10, clock=50)
    nodes.spin_until(lambda: times and times[-1] >= FIRST_STAMP + 10 * NANOSECONDS)
    assert times == sorted(times)
    assert times[0] < FIRST_STAMP + 5 * NANOSECONDS


def test_a_night_in_the_recording_is_told_and_shortened(
    nodes: Any, file: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    person = Player(nodes, file, listeners=True, rate=0.05)
    person.until(lambda: len(person.heard["learner_1"]) == 1)
    person.until(lambda: "demonstration 2 was recorded 1 s after" in person.player.answer)
    person.until(lambda: person.statuses and "a gap in the recording" in person.statuses[-1].waiting)
    output = "".join(capfd.readouterr())
    assert output.count("learner_1: demonstration 2 was recorded 1 s after the one before and comes in 20 s") == 1
    quick = Player(nodes, file, listeners=True, rate=0.05, max_gap=1e-3)
    quick.until(lambda: len(quick.heard["learner_1"]) > 5)


def test_every_change_is_a_line_in_the_log(nodes: Any, file: Path, capfd: pytest.CaptureFixture[str]) -> None:
    person = Player(nodes, file, listeners=True, start_paused=True)
    person.call("set_rate", rate=4.0)
    person.call("seek", time=moment(3.0))
    person.call("resume")
    person.call("pause")
    person.player.set_parameters([Parameter("hz", value=7.0)])
    person.call("stop")
    output = "".join(capfd.readouterr())
    for line in ("rate 4", "seek to 1700000003.000 s", "playing at rate 4", "paused", "hz 7", "stopped"):
        assert f"]: {line}" in output, line


def test_whole_numbers_are_numbers(nodes: Any, file: Path) -> None:
    """As in -p rate:=10."""
    person = Player(nodes, file, rate=10, hz=2)
    assert person.call("get_rate").rate == 10.0
    (result,) = person.player.set_parameters([Parameter("rate", value=True)])
    assert not result.successful
    assert "expected a number" in result.reason
