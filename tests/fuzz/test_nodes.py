"""Nodes on topics where anybody may publish anything: they stay up, count what they refuse, and learn the same bits."""

import math
import random
import struct
from collections.abc import Callable
from typing import Any

import pytest
from harness import NODES, few, sent_to, topic_of
from hypothesis import given
from junk import spoil
from mabirds_msgs.msg import LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.serialization import serialize_message
from truth import Truth, bits, disturbed, true_messages, without_forgeries

from mabirds_core.errors import ExperimentError
from mabirds_learner.baseline_node import BaselineNode
from mabirds_msgs_py.qos import announced, latched


def removed(nodes: Any, node: Node) -> None:
    nodes.executor.remove_node(node)
    nodes.all.remove(node)
    node.destroy_node()


def dropped(heard: LearnerStatus) -> dict[str, int]:
    return dict(zip(heard.drop_reasons, heard.drop_counts, strict=True))


class Listener:
    """Hears the statuses and parameters of one node."""

    def __init__(self, nodes: Any, name: str) -> None:
        self.node = nodes.plain(f"listener_{len(nodes.all)}")
        self.statuses: list[LearnerStatus] = []
        self.parameters: dict[int, ParametersMessage] = {}
        self.node.create_subscription(LearnerStatus, f"/{name}/status", self.statuses.append, latched(1000))
        self.node.create_subscription(ParametersMessage, f"/{name}/parameters", self._on_parameters, latched(1000))

    def _on_parameters(self, message: ParametersMessage) -> None:
        self.parameters[message.iteration] = message

    @property
    def finished(self) -> bool:
        return bool(self.statuses) and self.statuses[-1].state == LearnerStatus.FINISHED

    @property
    def bits(self) -> list[tuple[bytes, bytes]]:
        return [(one.theta.tobytes(), one.omega.tobytes()) for _, one in sorted(self.parameters.items())]


@NODES
def test_a_learner_node_learns_the_same_bits_whatever_else_is_sent(truth: Truth, nodes: Any, count: int) -> None:
    expected = [bits(one) for one in truth.history["learner_1"]]

    @few(count)
    @given(disturbed(lambda: true_messages(truth, ["learner_1"], ["learner_2"])))
    def check(messages: list[tuple[str, Any]]) -> None:
        node = nodes.learner(truth.file, "learner_1")
        try:
            for sender, message in without_forgeries(truth, messages):
                sent_to(node, topic_of(sender, message), message)
                nodes.executor.spin_once(timeout_sec=0)
            nodes.spin_until(lambda: node.session.finished)
            assert [bits(one) for _, one in sorted(node.session.kept.items())] == expected
        finally:
            removed(nodes, node)

    check()


@NODES
def test_a_baseline_node_learns_the_same_bits_whatever_else_is_sent(truth: Truth, nodes: Any, count: int) -> None:
    names = list(truth.experiment.learners)

    def learned(messages: list[tuple[str, Any]]) -> tuple[bytes, bytes]:
        overrides = [Parameter("experiment", value=str(truth.file))]
        node = nodes.add(BaselineNode(context=nodes.context, namespace="/bics", parameter_overrides=overrides))
        try:
            for sender, message in messages:
                sent_to(node, topic_of(sender, message), message)
                nodes.executor.spin_once(timeout_sec=0)
            nodes.spin_until(lambda: node.session.finished)
            return bits(node.session.parameters)
        finally:
            removed(nodes, node)

    undisturbed = learned(list(true_messages(truth, names, [])))

    @few(count)
    @given(disturbed(lambda: true_messages(truth, names, [])))
    def check(messages: list[tuple[str, Any]]) -> None:
        assert learned(list(without_forgeries(truth, messages))) == undisturbed

    check()


def broken(content: bytes, rng: random.Random) -> bytes:
    """Serialized messages that are cut, lengthened, or lie about lengths."""
    damaged = bytearray(content)
    for _ in range(rng.randint(1, 3)):
        place = rng.randrange(len(damaged) + 1)
        match rng.randrange(4):
            case 0:
                del damaged[place:]
            case 1:
                damaged[place:place] = rng.randbytes(7)
            case 2:
                damaged[place : place + 4] = struct.pack("<I", rng.choice([0, 2**20, 2**31 - 1, 2**32 - 1]))
            case 3:
                damaged[place : place + 1] = rng.randbytes(1)
    return bytes(damaged)


@pytest.mark.parametrize(
    ("seed", "count"), [(1, 100), *(pytest.param(seed, 3000, marks=pytest.mark.slow) for seed in (2, 3))]
)
def test_bytes_that_are_no_message_change_nothing(truth: Truth, nodes: Any, seed: int, count: int) -> None:
    """On the wire itself, before the true messages: the middleware drops what cannot be one, the node the rest."""
    listener, rng = Listener(nodes, "learner_1"), random.Random(seed)
    node = nodes.learner(truth.file, "learner_1", demonstration_history=10_000)
    sound = {
        "/learner_1/demonstration": truth.demonstration("learner_1", 1),
        "/learner_2/parameters": truth.parameters("learner_2", 1),
    }
    publishers = {name: listener.node.create_publisher(type(one), name, announced(100)) for name, one in sound.items()}
    for topic, message in sound.items():
        message.iteration = 0  # or else what is left whole of it would be a forgery
        for _ in range(count):
            publishers[topic].publish(broken(serialize_message(message), rng))
            nodes.executor.spin_once(timeout_sec=0)
    for sender, message in true_messages(truth, ["learner_1"], ["learner_2"]):
        publishers[topic_of(sender, message)].publish(message)
    nodes.spin_until(lambda: node.session.finished and len(listener.parameters) == 7)
    assert listener.bits == [bits(one) for one in truth.history["learner_1"]]


def test_an_intruder_is_dropped_and_counted(make_truth: Callable[..., Truth], nodes: Any) -> None:
    """It publishes for an edge that the schedule does not have, as another learner, and at the wrong time."""
    line = [["learner_1", "learner_2"], ["learner_2", "learner_3"]]
    truth = make_truth(learners=3, schedule={"kind": "slots", "slots": [line, line], "undirected": True})
    listener, node = Listener(nodes, "learner_1"), nodes.learner(truth.file, "learner_1")
    assert "/learner_3/parameters" not in [one.topic_name for one in node.subscriptions]
    wrong = truth.parameters("learner_2", 1)
    wrong.theta[0] = 1e300
    for message in (
        truth.parameters("learner_3", 1),
        wrong,
        truth.parameters("learner_2", 1),
        truth.parameters("learner_2", 1),
        spoil(truth.parameters("learner_2", 1), omega=truth.parameters("learner_2", 2).omega),
        spoil(truth.parameters("learner_2", 1), iteration=0),
        spoil(truth.parameters("learner_2", 1), iteration=2**64 - 1),
    ):
        sent_to(node, "/learner_2/parameters", message)
    for sender, message in true_messages(truth, ["learner_1"], ["learner_2"]):
        sent_to(node, topic_of(sender, message), message)
    nodes.spin_until(lambda: listener.finished and len(listener.parameters) == 7)
    assert listener.bits == [bits(one) for one in truth.history["learner_1"]]
    counted = dropped(listener.statuses[-1])
    assert counted["wrong_learner"] == counted["too_large"] == counted["conflict"] == counted["future_iteration"] == 1
    # The true parameters of iteration 1 come after the demonstration that completed its update.
    assert (counted["duplicate"], counted["old_iteration"]) == (1, 2)


def test_two_learners_of_one_name_change_nothing(make_truth: Callable[..., Truth], nodes: Any) -> None:
    """Both learn the same, since a learner has no state that its experiment, name and messages do not decide."""
    truth = make_truth(iterations=4)
    listeners = [Listener(nodes, name) for name in ("learner_1", "learner_2")]
    player = nodes.player(truth.file, hz=50.0)
    twins = [nodes.learner(truth.file, name) for name in ("learner_1", "learner_1", "learner_2")]
    nodes.spin_until(lambda: player.done and all(node.session.finished for node in twins))
    nodes.spin_until(lambda: all(len(one.parameters) == 5 for one in listeners))
    for listener, name in zip(listeners, ("learner_1", "learner_2"), strict=True):
        assert listener.bits == [bits(one) for one in truth.history[name]]


@pytest.mark.parametrize(
    ("parameters", "error", "text"),
    [
        ({"status_period": math.nan}, InvalidParameterValueException, "out of range"),
        ({"status_period": math.inf}, InvalidParameterValueException, "out of range"),
        ({"status_period": -1.0}, InvalidParameterValueException, "out of range"),
        ({"status_period": "often"}, InvalidParameterTypeException, "status_period"),
        ({"demonstration_history": 0}, InvalidParameterValueException, "out of range"),
        ({"demonstration_history": 2**62}, InvalidParameterValueException, "out of range"),
        ({"parameter_history": -1}, InvalidParameterValueException, "out of range"),
        ({"experiment": ""}, ExperimentError, "the parameter experiment is not set; give -p experiment:=FILE"),
        ({"experiment": "/nowhere"}, ExperimentError, "/nowhere: cannot be read (No such file or directory)"),
        ({"experiment": "/" + "x" * 5000}, ExperimentError, "cannot be read (File name too long)"),
        ({"experiment": "/dev/zero"}, ExperimentError, "/dev/zero: is not YAML: it has more than 1048576 bytes"),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_learner_with_wrong_parameters_does_not_start(
    truth: Truth, nodes: Any, parameters: dict[str, Any], error: type[Exception], text: str
) -> None:
    file = parameters.pop("experiment", str(truth.file))
    with pytest.raises(error) as refused:
        nodes.learner(file, "learner_1", **parameters)
    assert text in str(refused.value)


@pytest.mark.parametrize(
    ("parameters", "error", "text"),
    [
        ({"rate": math.nan}, InvalidParameterValueException, "out of range"),
        ({"rate": math.inf}, InvalidParameterValueException, "out of range"),
        ({"rate": -1.0}, InvalidParameterValueException, "out of range"),
        ({"hz": math.nan}, InvalidParameterValueException, "out of range"),
        ({"hz": "fast"}, InvalidParameterValueException, "expected a number from 0"),
        ({"max_in_flight": 0}, InvalidParameterValueException, "out of range"),
        ({"max_in_flight": 2**40}, InvalidParameterValueException, "out of range"),
        (
            {"baseline": "no such method!"},
            ExperimentError,
            "baseline 'no such method!': expected one of ('bics', 'dlm'",
        ),
    ],
    ids=lambda value: str(value)[:40],
)
def test_a_player_with_wrong_parameters_does_not_start(
    truth: Truth, nodes: Any, parameters: dict[str, Any], error: type[Exception], text: str
) -> None:
    with pytest.raises(error) as refused:
        nodes.player(truth.file, **parameters)
    assert text in str(refused.value)
