"""What the ROS graph says about who listens to whom."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from mabirds_msgs.msg import Parameters

from mabirds_bringup.run import processes
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.interfaces import type_hash

TOPICS = ("demonstration", "parameters")
# learner_1 and learner_3 never talk to each other directly.
LINE = [["learner_1", "learner_2"], ["learner_2", "learner_3"]]


@pytest.fixture
def graph(make_experiment: Callable[..., Path], nodes: Any, tmp_path: Path) -> Any:
    """Three learners as processes, and a node that looks at the graph once it is complete."""
    file = make_experiment(learners=3, schedule={"kind": "slots", "slots": [LINE], "undirected": True})
    names = load_experiment(file).learners
    children = [processes.start(name, processes.learner_command(name, file), tmp_path) for name in names]
    observer = nodes.plain("observer")
    nodes.spin_until(lambda: all(known(observer, f"/{name}/{topic}") for name in names for topic in TOPICS))
    yield observer
    processes.stop(children)


def known(observer: Any, topic: str) -> bool:
    """Are there subscriptions, and has the graph learned whose they are?"""
    found = subscribers(observer, topic)
    return bool(found) and all(namespace.startswith("/") for namespace in found)


def subscribers(observer: Any, topic: str) -> set[str]:
    return {info.node_namespace for info in observer.get_subscriptions_info_by_topic(topic)}


def test_each_demonstration_topic_has_its_own_learner_only(graph: Any) -> None:
    for name in ("learner_1", "learner_2", "learner_3"):
        assert subscribers(graph, f"/{name}/demonstration") == {f"/{name}"}


def test_parameters_are_subscribed_along_the_schedule_only(graph: Any) -> None:
    assert subscribers(graph, "/learner_1/parameters") == {"/learner_2"}
    assert subscribers(graph, "/learner_2/parameters") == {"/learner_1", "/learner_3"}
    assert subscribers(graph, "/learner_3/parameters") == {"/learner_2"}


def test_a_learner_subscribes_to_nothing_else(graph: Any) -> None:
    subscriptions = {topic for topic, _ in graph.get_subscriber_names_and_types_by_node("learner", "/learner_1")}
    assert subscriptions == {"/learner_1/demonstration", "/learner_2/parameters"}


def test_the_types_on_the_wire_are_the_installed_ones(graph: Any) -> None:

    (publisher,) = graph.get_publishers_info_by_topic("/learner_1/parameters")
    assert str(publisher.topic_type_hash).startswith("RIHS01_")
    assert str(publisher.topic_type_hash) == type_hash(Parameters)
