"""Replay of the patrol bag at any speed, with pauses, steps, seeks and changes of rate, ends in the same bits."""

from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from identity import assert_same_histories
from mabirds_msgs.msg import Demonstration
from rclpy.context import Context

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import History
from mabirds_expert_player.recorder import FIRST_STAMP
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.conversion import NANOSECONDS, time_message
from mabirds_msgs_py.player_services import service_type
from mabirds_msgs_py.qos import latched

PATROL = Path(__file__).resolve().parents[2] / "ros_ws" / "config" / "patrol.yaml"

UNBOUNDED = 1e9


@pytest.fixture(scope="module")
def reference() -> History:
    """The same learning in one loop."""
    return simulate_from_bag(load_experiment(PATROL))


@pytest.mark.parametrize("rate", [0.5, 1.0, 10.0, UNBOUNDED])
def test_the_patrol_bag_ends_in_the_same_bits(
    nodes: Any, context: Context, tmp_path: Path, reference: History, rate: float
) -> None:
    """Two learners of the package, a listener, and a person who asks for everything there is on the way."""
    experiment = load_experiment(PATROL)
    with BagWriter(tmp_path / "recording") as recording:
        monitor = nodes.add(MonitorNode(experiment, recording, context=context))
        person, heard = nodes.plain("person"), list[int]()
        person.create_subscription(
            Demonstration, "/learner_1/demonstration", lambda message: heard.append(message.iteration), latched(256)
        )
        for name in experiment.learners:
            nodes.learner(PATROL, name)
        player = nodes.player(PATROL, rate=rate, start_paused=True, max_in_flight=4)

        def ask(name: str, **fields: Any) -> Any:
            kind = service_type(name)
            return nodes.call(person.create_client(kind, f"/expert_player/{name}"), kind.Request(**fields))

        def learned() -> int:
            return min(stream.acknowledged for stream in player.playback.streams.values())

        nodes.spin_until(lambda: all(stream.ready for stream in player.playback.streams.values()))
        assert ask("play_next").success
        assert ask("burst", num_messages=9).actually_burst == 9
        ask("resume")
        nodes.spin_until(lambda: learned() >= 6)
        ask("pause")
        assert not ask("seek", time=moment(0.0)).success
        assert ask("seek", time=moment(12.0)).success
        ask("toggle_paused")
        nodes.spin_until(lambda: learned() >= 12)
        assert ask("set_rate", rate=25.0).success
        nodes.spin_until(lambda: learned() >= 16)
        assert ask("set_rate", rate=rate).success
        assert ask("seek", time=moment(36.0)).success
        nodes.spin_until(lambda: learned() >= 37)
        nodes.spin_until(lambda: monitor.finished)
    assert_same_histories(monitor.history(), reference)
    assert sorted(set(heard)) == list(range(1, 41))


def moment(seconds: float) -> Time:
    """After the first demonstration."""
    return time_message(FIRST_STAMP + round(seconds * NANOSECONDS))
