"""Learners beside a node that draws them: what stock tools are configured for exists, with its types and fields."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import pytest
import rclpy
import yaml
from nav_msgs.msg import OccupancyGrid
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from std_msgs.msg import Float64

from mabirds_bringup.draw.listener import DrawnListener
from mabirds_bringup.draw.node import DrawingNode
from mabirds_bringup.watch.described import describe
from mabirds_bringup.watch.inspector import InspectorNode
from mabirds_core.costs.models import costs_of
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def display_files(monkeypatch: pytest.MonkeyPatch) -> Any:
    monkeypatch.syspath_prepend(str(ROOT / "tools"))
    import display_files

    yield display_files
    del sys.modules["display_files"]


def published(node: Any) -> dict[str, list[str]]:
    return dict(node.get_topic_names_and_types())


def topics_in(layout: Any) -> set[str]:
    """Topics of a Foxglove layout."""
    panels = layout["configById"].values()
    plotted = {path["value"].rpartition(".")[0] for panel in panels for path in panel.get("paths", ())}
    return plotted | {topic for panel in panels for topic in panel.get("topics", ())}


@pytest.mark.parametrize("cost", [{}, {"cost": {"kind": "network", "apart": 0.0}}], ids=["linear", "network"])
def test_displays_name_what_is_published_and_it_says_what_was_learned(
    make_experiment: Callable[..., Path], nodes: Any, context: Context, display_files: Any, cost: dict[str, Any]
) -> None:
    experiment = load_experiment(make_experiment(iterations=6, change={"algorithm": cost}))
    file = Path(experiment.demonstrations.bag).parent / "experiment.yaml"
    drawing = nodes.add(DrawingNode(experiment, rate=20.0, demonstrations=True, context=context))
    listener = nodes.add(DrawnListener(context=context))
    scalars: list[float] = []
    learners = [nodes.learner(file, name) for name in experiment.learners]
    topic = "/learner_1/drawn/scalars/iteration"
    drawing.create_subscription(Float64, topic, lambda message: scalars.append(message.data), 50)
    nodes.player(file, hz=20.0)
    nodes.spin_until(lambda: all(learner.session.finished for learner in learners))
    costs = "/learner_2/drawn/costs/expert_1"
    nodes.spin_until(
        lambda: "/learner_2/drawn/markers" in listener.drawn and costs in listener.drawn and scalars[-1:] == [7.0]
    )
    nodes.spin_for(0.5)

    expected, there = display_files.drawn_topics(), published(listener)
    assert {topic: there.get(topic) for topic in expected} == {topic: [kind] for topic, kind in expected.items()}
    layout = json.loads(display_files.FOXGLOVE.read_text(encoding="utf-8"))
    assert topics_in(layout) - set(there) == set()
    assert {
        path.rpartition(".")[2]
        for panel in layout["configById"].values()
        for path in (entry["value"] for entry in panel.get("paths", ()))
    } == {"data"}
    assert set(Float64.get_fields_and_field_types()) == {"data"}

    game, session = build_game(experiment), learners[1].session
    shown: OccupancyGrid = listener.drawn[costs]
    omega = costs_of(session.learner.game).by_feature(session.parameters.omega)
    table = np.array(shown.data, dtype=np.int8).reshape(shown.info.height, shown.info.width)
    most = max(0.0, -omega[: 2 * 12].min())
    by_cell = np.clip(-omega[:12].reshape(3, 4)[::-1] / most, 0, 1)
    assert np.abs(table - 100 * by_cell).max() <= 0.5 + 1e-9
    path = listener.drawn["/learner_1/drawn/demonstrated/expert_2"]
    assert len(path.poses) == game.horizon + 1
    assert (path.poses[-1].pose.position.x, path.poses[-1].pose.position.y) == (0.5, 2.5)  # its goal, (0, 0)
    assert "/learner_1/drawn/imagined/expert_1" in listener.drawn
    assert 7.0 in scalars


def test_files_of_rviz_and_foxglove_are_those_that_the_script_writes(display_files: Any) -> None:
    assert json.loads(display_files.FOXGLOVE.read_text(encoding="utf-8")) == display_files.foxglove()
    assert yaml.safe_load(display_files.RVIZ.read_text(encoding="utf-8")) == display_files.rviz()
    shown = [display["Topic"]["Value"] for display in display_files.rviz()["Visualization Manager"]["Displays"]]
    assert sorted(shown) == sorted(display_files.drawn_topics())
    nav2 = yaml.safe_load((ROOT / "ros_ws" / "nav2" / "keepout.yaml").read_text(encoding="utf-8"))
    mask = nav2["costmap_filter_info_server"]["ros__parameters"]["mask_topic"]
    assert display_files.drawn_topics()[mask] == "nav_msgs/msg/OccupancyGrid"


def test_whoever_comes_late_from_another_host_sees_names(
    make_experiment: Callable[..., Path], nodes: Any, ros_domain: int
) -> None:
    """The file of the experiment is gone, as it is where a host has never had it."""
    file = make_experiment(iterations=6, change={"algorithm": {}})
    learners = [nodes.learner(file, name) for name in ("learner_1", "learner_2")]
    nodes.player(file, hz=50.0)
    nodes.spin_until(lambda: all(learner.session.finished for learner in learners))
    file.unlink()
    elsewhere = Context()
    rclpy.init(args=[], context=elsewhere, domain_id=ros_domain)
    late, executor = InspectorNode(context=elsewhere), SingleThreadedExecutor(context=elsewhere)
    executor.add_node(late)

    def heard() -> bool:
        executor.spin_once(timeout_sec=0.02)
        return late.complete

    nodes.spin_until(heard)
    for learner in late.learners.values():
        content = describe(learner, top=26)
        assert content["iteration"] == content["parameters"]["iteration"] == 7
        assert content["state"] == "finished"
        assert {one["feature"] for one in content["parameters"]["costliest"]} == set(
            learners[0].game.cost_features.names
        )
        assert learner.names.theta[0] == "expert_1 in (0, 0) going north"
    executor.shutdown()
    late.destroy_node()
    rclpy.try_shutdown(context=elsewhere)


def test_a_picture_of_nothing_is_told_and_not_made(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "mabirds_bringup", "picture", str(tmp_path / "drawn.png"), "--timeout", "1"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert (done.returncode, done.stdout) == (4, "")
    assert "start `mabirds draw`" in done.stderr
    assert list(tmp_path.iterdir()) == []


def test_demonstrations_are_not_drawn_where_security_is_on(make_experiment: Callable[..., Path]) -> None:
    """For no enclave of drawings may hear them."""
    command = [sys.executable, "-m", "mabirds_bringup", "draw", str(make_experiment()), "--demonstrations"]
    settings = {**os.environ, "ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce"}
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, env=settings)
    assert (done.returncode, done.stdout) == (2, "")
    assert "learners alone may hear what they are shown; leave it out" in " ".join(done.stderr.split())


def test_drawings_of_a_process_become_a_picture(
    make_experiment: Callable[..., Path], nodes: Any, tmp_path: Path
) -> None:
    file = make_experiment(iterations=6)
    learners = [nodes.learner(file, name) for name in ("learner_1", "learner_2")]
    nodes.player(file, hz=50.0)
    mabirds = [sys.executable, "-m", "mabirds_bringup"]
    drawing = subprocess.Popen([*mabirds, "draw", str(file)], stderr=subprocess.PIPE, stdout=subprocess.PIPE)
    try:
        nodes.spin_until(lambda: all(learner.session.finished for learner in learners))
        picture = subprocess.Popen([*mabirds, "picture", str(tmp_path / "drawn.png")], stderr=subprocess.DEVNULL)
        nodes.spin_until(lambda: picture.poll() is not None, 120.0)
        assert picture.returncode == 0
        height, width = plt.imread(tmp_path / "drawn.png").shape[:2]
        assert min(height, width) > 400
    finally:
        drawing.terminate()
        assert drawing.communicate()[0] == b""
    assert drawing.returncode == 0
