"""A network of processes whose every topic somebody else publishes to: the run ends, and every bit is right."""

import random
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import rclpy
from junk import spoil
from mabirds_msgs.msg import Demonstration, EdgeSchedule, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy.context import Context
from rclpy.node import Node
from truth import Truth, bits, copied

from mabirds_bringup.evaluate.results import audit
from mabirds_bringup.run.network import Network
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_msgs_py.qos import STATUS_QOS, announced, latched

Spoil = Callable[[Any], Any]

NAN, INFINITY = float("nan"), float("inf")

TO_ALL: list[Spoil] = [
    lambda m: spoil(m, learner="nobody"),
    lambda m: spoil(m, learner="\n\x1b[2J" * 1000),
    lambda m: spoil(m, experiment_digest="another run's"),
]
TO_DEMONSTRATIONS: list[Spoil] = [
    *TO_ALL,
    lambda m: spoil(m, game_digest=""),
    lambda m: spoil(m, states=[NAN] * 32),
    lambda m: spoil(m, states=[1e300] * 32),
    lambda m: spoil(m, actions=[INFINITY] * 16),
    lambda m: spoil(m, steps=2**32 - 1),
    lambda m: spoil(m, iteration=0),
    lambda m: spoil(m, iteration=2**64 - 1),
]
TO_PARAMETERS: list[Spoil] = [
    *TO_ALL,
    lambda m: spoil(m, schedule_digest=""),
    lambda m: spoil(m, theta=[NAN] * 96),
    lambda m: spoil(m, omega=[-INFINITY] * 26),
    lambda m: spoil(m, omega=[1e300] * 26),
    lambda m: spoil(m, theta=[0.0]),
    lambda m: spoil(m, iteration=0),
    lambda m: spoil(m, iteration=2**64 - 1),
]
TO_STATUSES: list[Spoil] = [
    *TO_ALL,
    lambda m: spoil(m, last_demonstration=2**64 - 1),
    lambda m: spoil(m, last_demonstration=2**32, iteration=2**64 - 1, state=LearnerStatus.FINISHED),
    lambda m: spoil(m, last_demonstration=2**32, mixed_from=["nobody"]),
]
TO_SCHEDULES: list[Spoil] = [lambda m: spoil(m, learners=["nobody"]), lambda m: spoil(m, slots=2**32 - 1)]
LIES: dict[type, list[Spoil]] = {
    Demonstration: TO_DEMONSTRATIONS,
    ParametersMessage: TO_PARAMETERS,
    LearnerStatus: TO_STATUSES,
    EdgeSchedule: TO_SCHEDULES,
}


PERIOD = 0.03
"""Seconds between two salvos: as many messages as the learners themselves send, and more."""


def lies_in_turn(rng: random.Random, lies: list[Spoil]) -> Iterator[Spoil]:
    """Every lie once before any is told again, in random order: none is left to chance in a short run."""
    while True:
        yield from rng.sample(lies, len(lies))


class Intruder:
    """Overhears one learner and publishes what it said, spoiled, on all topics of that learner.

    Its lies about what was learned go beyond what there is to learn, or belong to nobody: a status that fits in every
    respect cannot be told from a true one.
    """

    def __init__(self, node: Node, truth: Truth, name: str, rng: random.Random) -> None:
        self.truth, self.name, self.rng, self.sent, self.next = truth, name, rng, 0, 0.0
        self.lies = {kind: lies_in_turn(rng, lies) for kind, lies in LIES.items()}
        self.heard: list[ParametersMessage] = []
        node.create_subscription(ParametersMessage, f"/{name}/parameters", self.heard.append, latched(100))
        publish = node.create_publisher
        self.demonstrations = publish(Demonstration, f"/{name}/demonstration", latched(100))
        self.parameters = publish(ParametersMessage, f"/{name}/parameters", announced(100))
        self.statuses = publish(LearnerStatus, f"/{name}/status", STATUS_QOS)
        self.schedules = publish(EdgeSchedule, f"/{name}/edge_schedule", STATUS_QOS)

    def fire(self, digest: str) -> None:
        """One salvo, if it is time; ``digest``: of the run."""
        if time.monotonic() < self.next:
            return
        self.next = time.monotonic() + PERIOD
        demonstration = self.truth.demonstration(self.name, self.rng.randint(1, self.truth.experiment.iterations))
        demonstration.experiment_digest = digest
        self.demonstrations.publish(next(self.lies[Demonstration])(demonstration))
        self.statuses.publish(next(self.lies[LearnerStatus])(self.truth.status(self.name, experiment_digest=digest)))
        self.schedules.publish(next(self.lies[EdgeSchedule])(self.truth.schedule()))
        if self.heard:
            self.parameters.publish(next(self.lies[ParametersMessage])(copied(self.rng.choice(self.heard))))
        self.sent += 1


@pytest.fixture
def stranger(ros_domain: int) -> Iterator[Any]:
    """A node that is no part of the network, and its executor."""
    context = Context()
    rclpy.init(args=[], context=context, domain_id=ros_domain)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    node = Node("stranger", context=context)
    executor.add_node(node)
    yield node, executor
    executor.shutdown(timeout_sec=5)
    node.destroy_node()
    rclpy.try_shutdown(context=context)


@pytest.mark.parametrize(
    ("seed", "iterations"), [(1, 12), *(pytest.param(seed, 100, marks=pytest.mark.slow) for seed in (2, 3))]
)
def test_a_network_under_fire_learns_the_same_bits(
    make_truth: Callable[..., Truth], stranger: Any, tmp_path: Path, seed: int, iterations: int
) -> None:
    truth = make_truth(learners=3, iterations=iterations)
    (tmp_path / "logs").mkdir()
    node, executor = stranger
    rng = random.Random(seed)
    intruders = [Intruder(node, truth, name, rng) for name in truth.experiment.learners]
    dropped: dict[str, set[str]] = {}

    def on_tick(monitor: MonitorNode, *_: object) -> None:
        executor.spin_once(timeout_sec=0)
        for intruder in intruders:
            if intruder.name in monitor.statuses:
                status = monitor.statuses[intruder.name]
                dropped[intruder.name] = set(status.drop_reasons)
                intruder.fire(status.experiment_digest)

    result = Network(truth.experiment, truth.file, tmp_path, {"hz": 10.0}).run(on_tick)
    found = {name: [bits(one) for one in history] for name, history in result.history.items()}
    assert found == {name: [bits(one) for one in history] for name, history in truth.history.items()}
    assert audit(truth.experiment.edge_schedule, result.delivered, iterations)["edge_mismatches"] == []
    assert all(intruder.sent > 10 for intruder in intruders)
    assert all({"wrong_learner", "wrong_experiment", "wrong_shape"} <= reasons for reasons in dropped.values())
    for log in (tmp_path / "logs").glob("*.log"):
        text = log.read_text(encoding="utf-8")
        assert len(text) < 20_000, log
        assert "\x1b[2J" not in text
