"""Central methods as ROS nodes on all demonstration topics, bit for bit as in process."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rclpy.context import Context
from rclpy.parameter import Parameter

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.run.network import Network
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import load_experiment
from mabirds_learner.baseline_node import BaselineNode
from mabirds_msgs_py.bag_writer import BagWriter


def bits(parameters: list[Parameters]) -> list[tuple[bytes, bytes]]:
    return [(one.theta.tobytes(), one.omega.tobytes()) for one in parameters]


@pytest.mark.parametrize("method", ["bics", "ftl", "dlm", "me_greedy", "me_gradient"])
def test_a_baseline_node_equals_the_reference(
    make_experiment: Callable[..., Path], nodes: Any, context: Context, tmp_path: Path, method: str
) -> None:
    file = make_experiment(learners=3, iterations=6)
    experiment = load_experiment(file)
    with BagWriter(tmp_path / "recording") as recording:
        monitor = nodes.add(MonitorNode(experiment, recording, names=[method], context=context))
        overrides = [Parameter("experiment", value=str(file))]
        node = nodes.add(BaselineNode(context=context, namespace=f"/{method}", parameter_overrides=overrides))
        player = nodes.player(file, hz=50.0, baseline=method)
        nodes.spin_until(lambda: monitor.finished and player.done)
    assert bits(monitor.history()[method]) == bits(simulate_from_bag(experiment, method)[method])
    topics = {name for name, _ in node.get_subscriber_names_and_types_by_node("baseline", f"/{method}")}
    assert {f"/{learner}/demonstration" for learner in experiment.learners} <= topics
    status = monitor.statuses[method]
    assert dict(zip(status.metric_names, status.metric_values, strict=True))["policy_solves"] >= 6


def test_a_central_method_as_a_process(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    file = make_experiment(iterations=6)
    experiment = load_experiment(file)
    (tmp_path / "logs").mkdir()
    history = Network(experiment, file, tmp_path, {"hz": 20.0}, method="bics").run().history
    assert bits(history["bics"]) == bits(simulate_from_bag(experiment, "bics")["bics"])


def test_a_namespace_that_is_no_method_is_refused(make_experiment: Callable[..., Path], context: Context) -> None:
    overrides = [Parameter("experiment", value=str(make_experiment()))]
    with pytest.raises(ExperimentError, match="'genie' is none of the methods"):
        BaselineNode(context=context, namespace="/genie", parameter_overrides=overrides)
