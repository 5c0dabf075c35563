"""The player node: speed, holding back, pausing, sending again, and refusing to play to another game."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
from mabirds_msgs.srv import Resend
from pretend_learners import PretendLearners
from rcl_interfaces.msg import FloatingPointRange
from rclpy.parameter import Parameter

from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.errors import BagError


@pytest.fixture
def file(make_experiment: Callable[..., Path]) -> Path:
    return make_experiment(iterations=30)


@pytest.fixture
def learners(file: Path, nodes: Any) -> PretendLearners:

    return PretendLearners(nodes, load_experiment(file))


def test_nothing_is_sent_before_a_learner_is_there(nodes: Any, file: Path, learners: PretendLearners) -> None:
    nodes.player(file, hz=100.0)
    nodes.spin_for(0.5)
    assert learners.received == {}
    learners.acknowledge("learner_2", 0)
    nodes.spin_until(lambda: len(learners.received["learner_2"]) > 2)
    assert learners.received["learner_1"] == []


def test_it_never_runs_further_ahead_than_the_window(nodes: Any, file: Path, learners: PretendLearners) -> None:
    nodes.player(file, hz=200.0, max_in_flight=4)
    learners.acknowledge("learner_1", 0)
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 4)
    nodes.spin_for(0.3)
    assert learners.received["learner_1"] == [1, 2, 3, 4]
    learners.acknowledge("learner_1", 3)
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 7)
    nodes.spin_for(0.3)
    assert learners.received["learner_1"] == [1, 2, 3, 4, 5, 6, 7]


def test_holding_back_is_said(
    nodes: Any, file: Path, learners: PretendLearners, capfd: pytest.CaptureFixture[str]
) -> None:
    nodes.player(file, hz=200.0, max_in_flight=4)
    learners.acknowledge("learner_1", 0)
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 4)
    nodes.spin_for(0.1)
    learners.acknowledge("learner_1", 4)
    nodes.spin_until(lambda: len(learners.received["learner_1"]) > 4)
    output = "".join(capfd.readouterr())
    assert output.count("holding learner_1 back: sent 4, learned 0, max_in_flight 4") == 1
    assert output.count("learner_1 caught up to 4") == 1


def gaps(times: list[float]) -> list[float]:
    return [later - earlier for earlier, later in pairwise(times)]


def median(values: list[float]) -> float:
    return sorted(values)[len(values) // 2]


def test_rate_multiplies_the_recorded_timing(nodes: Any, file: Path, learners: PretendLearners) -> None:
    nodes.player(file, rate=20.0)  # recorded once a second
    learners.acknowledge("learner_1", 0)
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 12)
    assert median(gaps(learners.times["learner_1"])) == pytest.approx(0.05, abs=0.02)


def test_hz_can_change_while_it_plays(nodes: Any, file: Path, learners: PretendLearners) -> None:
    player = nodes.player(file, hz=5.0)
    learners.acknowledge("learner_1", 0)
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 5)
    player.set_parameters([Parameter("hz", value=50.0)])
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 15)
    times = learners.times["learner_1"]
    assert median(gaps(times[:5])) == pytest.approx(0.2, abs=0.05)
    assert median(gaps(times[6:])) == pytest.approx(0.02, abs=0.015)


def test_rate_can_change_while_it_plays(nodes: Any, file: Path, learners: PretendLearners) -> None:
    player = nodes.player(file, rate=5.0)
    learners.acknowledge("learner_1", 0)
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 4)
    player.set_parameters([Parameter("rate", value=50.0)])
    nodes.spin_until(lambda: len(learners.received["learner_1"]) == 14)
    assert median(gaps(learners.times["learner_1"][5:])) == pytest.approx(0.02, abs=0.015)


def test_the_slowest_speed_is_no_trouble(nodes: Any, file: Path, learners: PretendLearners) -> None:
    nodes.player(file, hz=1e-12)
    learners.acknowledge("learner_1", 0)
    nodes.spin_until(lambda: learners.received["learner_1"] == [1])


def test_a_learner_of_another_run_gets_nothing(nodes: Any, file: Path, learners: PretendLearners) -> None:
    nodes.player(file, hz=100.0, run="tuesday")
    learners.acknowledge("learner_1", 0)
    nodes.spin_for(0.5)
    assert learners.received == {}


@pytest.mark.parametrize(("name", "value"), [("rate", 0.0), ("rate", -1.0), ("hz", -0.5), ("hz", 1e10), ("rate", "x")])
def test_speeds_out_of_range_are_refused_and_change_nothing(nodes: Any, file: Path, name: str, value: Any) -> None:
    player = nodes.player(file)
    before = player.get_parameter(name).value
    (result,) = player.set_parameters([Parameter(name, value=value)])
    assert not result.successful
    assert result.reason
    assert player.get_parameter(name).value == before


def test_parameters_are_described_with_ranges(nodes: Any, file: Path) -> None:
    player = nodes.player(file)
    descriptor = player.describe_parameter("rate")
    assert descriptor.floating_point_range == [FloatingPointRange(from_value=1e-6, to_value=1e9)]
    assert all(
        player.describe_parameter(name).description for name in ("experiment", "bag", "max_in_flight", "rate", "hz")
    )


def test_resend_repeats_one_demonstration_to_its_own_learner(nodes: Any, file: Path, learners: PretendLearners) -> None:
    nodes.player(file, hz=200.0, max_in_flight=3)
    for name in ("learner_1", "learner_2"):
        learners.acknowledge(name, 0)
    nodes.spin_until(lambda: all(len(learners.received[name]) == 3 for name in ("learner_1", "learner_2")))
    client = learners.node.create_client(Resend, "/expert_player/resend")
    assert nodes.call(client, Resend.Request(learner="learner_2", iteration=2)).success
    nodes.spin_until(lambda: learners.received["learner_2"] == [1, 2, 3, 2])
    assert learners.received["learner_1"] == [1, 2, 3]
    for learner, iteration in (("learner_9", 1), ("learner_1", 4), ("learner_1", 0)):
        answer = nodes.call(client, Resend.Request(learner=learner, iteration=iteration))
        assert not answer.success
        assert "expected one of those sent" in answer.message


def test_what_a_learner_lost_is_sent_again(nodes: Any, file: Path, learners: PretendLearners) -> None:
    nodes.player(file, hz=200.0, max_in_flight=2)
    learners.acknowledge("learner_1", 0)
    nodes.spin_until(lambda: learners.received["learner_1"] == [1, 2])
    nodes.spin_for(2.1)
    learners.acknowledge("learner_1", 0)  # the heartbeat of a learner that never got them
    nodes.spin_until(lambda: learners.received["learner_1"] == [1, 2, 1, 2])


def test_a_learner_of_another_game_gets_nothing(nodes: Any, file: Path, capfd: pytest.CaptureFixture[str]) -> None:
    learners = PretendLearners(nodes, load_experiment(file), "another game")
    nodes.player(file, hz=100.0)
    learners.acknowledge("learner_1", 0)
    nodes.spin_for(0.5)
    assert learners.received == {}
    assert "learner_1 has another game: digest another game, here" in "".join(capfd.readouterr())


def test_the_setting_that_a_learner_has_otherwise_is_named(
    nodes: Any, file: Path, make_experiment: Callable[..., Path], capfd: pytest.CaptureFixture[str]
) -> None:
    nodes.player(file)
    nodes.learner(make_experiment(name="other", iterations=30, change={"seed": 4}), "learner_1", run="tuesday")
    said = [""]
    words = 'run is "tuesday" there and "" here; seed is 4 there and 3 here'
    nodes.spin_until(lambda: said.append(said[-1] + "".join(capfd.readouterr())) or words in said[-1], timeout=8.0)


def test_it_is_done_when_everything_is_acknowledged(nodes: Any, file: Path, learners: PretendLearners) -> None:
    player = nodes.player(file, hz=1000.0, max_in_flight=30)
    for name in ("learner_1", "learner_2"):
        learners.acknowledge(name, 0)
    nodes.spin_until(lambda: all(len(learners.received[name]) == 30 for name in ("learner_1", "learner_2")))
    assert not player.done
    for name in ("learner_1", "learner_2"):
        learners.acknowledge(name, 30)
    nodes.spin_until(lambda: player.done)


def test_a_bag_with_too_few_demonstrations_is_refused(nodes: Any, file: Path) -> None:
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("iterations: 30", "iterations: 31").replace("per_learner: 30", "per_learner: 31"))
    with pytest.raises(BagError, match="topic /learner_1/demonstration: 30 demonstrations, expected at least 31"):
        nodes.player(file)


def test_a_missing_bag_is_refused(nodes: Any, file: Path) -> None:
    with pytest.raises(BagError, match="give the directory of a rosbag2 bag"):
        nodes.player(file, bag="/nowhere")
