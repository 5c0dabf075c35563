"""Nodes in resilient mode: as strict while nothing is lost, on without the dead, and members by declaration."""

import os
import signal
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mabirds_msgs.msg import LearnerStatus, Mass, Membership
from rclpy.context import Context

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.run.declaration import DeclarationError, MembershipPublisher
from mabirds_bringup.run.network import Network
from mabirds_bringup.run.supervisor import Supervisor
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.mass_conversion import mass_message, membership_message
from mabirds_msgs_py.qos import announced, latched

NAMES = ("learner_1", "learner_2", "learner_3", "learner_4")


@pytest.fixture
def make_resilient(make_experiment: Callable[..., Path]) -> Callable[..., Path]:
    """A function that writes an experiment of four learners on a ring; ``patience`` in seconds."""

    def make(patience: float, iterations: int = 10, **change: Any) -> Path:
        change["mixing"] = {"kind": "resilient", "patience": patience}
        schedule = {"kind": "static", "graph": "ring"}
        return make_experiment(learners=4, iterations=iterations, schedule=schedule, change=change)

    return make


def test_while_nothing_is_lost_it_equals_strict_mode(
    make_resilient: Callable[..., Path], nodes: Any, context: Context, tmp_path: Path
) -> None:
    file = make_resilient(patience=60.0, closing_rounds=2)
    experiment = load_experiment(file)
    with BagWriter(tmp_path / "recording") as recording:
        monitor = nodes.add(MonitorNode(experiment, recording, context=context))
        for name in NAMES:
            nodes.learner(file, name)
        nodes.player(file, hz=50.0)
        nodes.spin_until(lambda: monitor.finished)
    strict = experiment.model_copy(update={"mixing": type(experiment).model_fields["mixing"].default})
    for name, expected in simulate_from_bag(strict).items():
        for one, other in zip(monitor.history()[name], expected, strict=True):
            np.testing.assert_allclose(one.theta, other.theta, rtol=0, atol=1e-12)
            np.testing.assert_allclose(one.omega, other.omega, rtol=0, atol=1e-12)
    assert monitor.mass_residual() == pytest.approx(0, abs=1e-12)


class Declarations:
    """A person who declares members, and listens to statuses."""

    def __init__(self, nodes: Any, file: Path) -> None:
        self.node, self.digest = nodes.plain("person"), load_experiment(file).digest
        self.statuses: dict[str, LearnerStatus] = {}
        self._publisher = self.node.create_publisher(Membership, "/membership", latched(16))
        for name in NAMES:
            self.node.create_subscription(LearnerStatus, f"/{name}/status", self._on_status, latched(1))

    def _on_status(self, status: LearnerStatus) -> None:
        self.statuses[status.learner] = status

    def declare(self, epoch: int, *members: str) -> None:
        self._publisher.publish(membership_message(self.digest, epoch, list(members)))


def test_learners_go_on_without_one_that_never_starts(make_resilient: Callable[..., Path], nodes: Any) -> None:
    file = make_resilient(patience=0.1)
    learners = [nodes.learner(file, name) for name in NAMES[:3]]
    nodes.player(file, hz=50.0)
    nodes.spin_until(lambda: all(node.session.finished for node in learners))
    assert learners[0].session.member.metrics()["weight_sent.learner_4"] > 0.1


def test_a_departure_is_declared_and_a_late_joiner_enters(make_resilient: Callable[..., Path], nodes: Any) -> None:
    file = make_resilient(patience=0.2, iterations=40)
    founders = [nodes.learner(file, name) for name in NAMES[:3]]
    person = Declarations(nodes, file)
    player = nodes.player(file, hz=20.0)
    person.declare(2, *NAMES[:3])
    nodes.spin_until(lambda: all(node.session.epoch == 2 for node in founders))
    nodes.spin_until(lambda: all(node.session.iteration >= 5 for node in founders))
    late_joiner = nodes.learner(file, "learner_4", late_joiner=True)
    assert late_joiner.session.epoch == 0
    person.declare(3, *NAMES)
    nodes.spin_until(lambda: late_joiner.session.epoch == 3 and not late_joiner.session.member.joining)
    assert late_joiner.session.iteration >= 5
    nodes.spin_until(lambda: all(node.session.finished for node in [*founders, late_joiner]) and player.done)
    nodes.spin_until(lambda: all(person.statuses[name].epoch == 3 for name in NAMES))
    last = [node.session.parameters.theta for node in [*founders, late_joiner]]
    assert max(np.linalg.norm(one - last[0]) for one in last) < np.linalg.norm(last[0])


def test_an_impossible_declaration_is_refused_by_name(make_resilient: Callable[..., Path], nodes: Any) -> None:
    file = make_resilient(patience=60.0)
    node, person = nodes.learner(file, "learner_1"), Declarations(nodes, file)
    person.declare(2, "learner_1", "learner_3")
    nodes.spin_until(lambda: "learner_1" in person.statuses and person.statuses["learner_1"].drop_reasons)
    status = person.statuses["learner_1"]
    assert list(status.drop_reasons) == ["impossible_schedule"]
    assert "nothing that learner_1 knows ever reaches learner_3" in status.message
    assert node.session.epoch == 1


@pytest.mark.parametrize(
    ("changes", "reason", "words"),
    [
        ({"learner": "learner_3"}, "wrong_learner", "learner 'learner_3', expected 'learner_2'"),
        ({"receiver": "learner_3"}, "wrong_learner", "receiver 'learner_3', expected 'learner_1'"),
        ({"experiment_digest": "other"}, "wrong_experiment", "experiment digest 'other', expected"),
        ({"schedule_digest": "other"}, "wrong_schedule", "schedule digest 'other', expected"),
        ({"total": [1.0]}, "wrong_shape", "total: 1 numbers, expected 151"),
        ({"rest": [float("nan")] * 151}, "not_finite", "rest: expected finite numbers"),
        ({"total": [1e200] * 151}, "too_large", "total: expected at most 1e+20 in absolute value"),
        ({"epoch": 0}, "old_epoch", ""),
    ],
)
def test_unfit_masses_are_counted_and_never_taken(
    make_resilient: Callable[..., Path], nodes: Any, changes: dict[str, Any], reason: str, words: str
) -> None:
    file = make_resilient(patience=60.0)
    node, person = nodes.learner(file, "learner_1"), Declarations(nodes, file)
    experiment, session = load_experiment(file), node.session
    message = mass_message("learner_2", "learner_1", 1, 1, next(iter(session.member.outgoing().values())))
    message.experiment_digest, message.schedule_digest = experiment.digest, experiment.edge_schedule.digest
    for name, value in changes.items():
        setattr(message, name, value)
    person.node.create_publisher(Mass, "/learner_2/mass/learner_1", announced(8)).publish(message)
    nodes.spin_until(lambda: "learner_1" in person.statuses and person.statuses["learner_1"].drop_reasons)
    assert list(person.statuses["learner_1"].drop_reasons) == [reason]
    assert words in person.statuses["learner_1"].message
    assert "learner_2" in session.missing_neighbours()


def test_a_declaration_waits_until_all_follow(make_resilient: Callable[..., Path], nodes: Any) -> None:
    file = make_resilient(patience=60.0)
    learners = [nodes.learner(file, name) for name in NAMES]
    declarer = nodes.add(MembershipPublisher(NAMES[:3], context=nodes.context))
    assert declarer.declare(nodes.executor, timeout=20.0) == 2
    assert [node.session.member.members for node in learners[:3]] == [NAMES[:3]] * 3
    nodes.spin_until(lambda: learners[3].session.finished)


def test_a_declaration_that_learners_refuse_says_why(make_resilient: Callable[..., Path], nodes: Any) -> None:
    file = make_resilient(patience=60.0)
    for name in NAMES:
        nodes.learner(file, name)
    declarer = nodes.add(MembershipPublisher(["learner_1", "learner_3"], context=nodes.context))
    with pytest.raises(DeclarationError, match="nothing that learner_1 knows ever reaches learner_3"):
        declarer.declare(nodes.executor, timeout=20.0)


def test_a_declaration_names_members_that_are_not_there(make_resilient: Callable[..., Path], nodes: Any) -> None:
    nodes.learner(make_resilient(patience=60.0), "learner_1")
    declarer = nodes.add(MembershipPublisher(["learner_1", "learner_2"], context=nodes.context))
    with pytest.raises(DeclarationError, match=r"learner_2: not heard within 2 s; start them, or leave them out"):
        declarer.declare(nodes.executor, timeout=2.0)


def test_learners_in_strict_mode_have_no_members(make_experiment: Callable[..., Path], nodes: Any) -> None:
    nodes.learner(make_experiment(), "learner_1")
    declarer = nodes.add(MembershipPublisher(["learner_1"], context=nodes.context))
    with pytest.raises(DeclarationError, match="these learners run in strict mode"):
        declarer.declare(nodes.executor, timeout=20.0)


def test_a_run_goes_on_without_a_learner_that_died_for_good(
    make_resilient: Callable[..., Path], tmp_path: Path
) -> None:
    """Processes: learner_3 is killed, nobody starts it again, and its departure is declared."""
    file, killed, news = make_resilient(patience=0.5, iterations=30), list[int](), list[str]()
    (tmp_path / "logs").mkdir()

    def kill_one(monitor: MonitorNode, supervisor: Supervisor, words: Sequence[str]) -> None:
        news.extend(words)
        victim = supervisor.children["learner_3"].process
        if not killed and victim and max(monitor.parameters["learner_3"], default=0) >= 5:
            killed.append(victim.popen.pid)
            os.kill(victim.popen.pid, signal.SIGKILL)

    result = Network(load_experiment(file), file, tmp_path, {"hz": 20.0}).run(kill_one)
    assert news == ["learner_3 ended with exit code -9 (SIGKILL); going on without it"]
    assert [len(result.history[name]) for name in ("learner_1", "learner_2", "learner_4")] == [31, 31, 31]
    assert 5 <= len(result.history["learner_3"]) < 31


def test_a_run_ends_when_a_living_learner_is_declared_to_have_departed(
    make_resilient: Callable[..., Path], tmp_path: Path
) -> None:
    """Processes: learner_3 lives, says that it has departed, and ends; the others learn all."""
    file, declared = make_resilient(patience=0.5, iterations=60), list[int]()
    experiment = load_experiment(file)
    (tmp_path / "logs").mkdir()
    exit_codes = list[int | None]()

    def declare(monitor: MonitorNode, supervisor: Supervisor, words: Sequence[str]) -> None:
        assert not words
        if not declared and min(log.newest for log in monitor.parameters.values()) >= 3:
            declared.append(1)
            others = ["learner_1", "learner_2", "learner_4"]
            digest = next(iter(monitor.statuses.values())).experiment_digest
            monitor._membership_publisher.publish(membership_message(digest, 2, ["learner_1"]))  # forged: no signature
            monitor._membership_publisher.publish(membership_message(digest, 2, others, monitor._key))
        process = supervisor.children["learner_3"].process
        exit_codes[:] = [process.exit_code if process else None]

    result = Network(experiment, file, tmp_path, {"hz": 6.0}).run(declare)
    assert result.departed == ["learner_3"]
    assert [len(result.history[name]) for name in ("learner_1", "learner_2", "learner_4")] == [61, 61, 61]
    assert exit_codes == [0]
    log = (tmp_path / "logs" / "learner_3.log").read_text(encoding="utf-8")
    assert "not signed with this run's key" in log
    assert "departed: epoch 2 goes on without learner_3; this one ends" in log
