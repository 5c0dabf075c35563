"""Policies say what nodes really do; security that is asked for is enforced, or nodes do not start."""

import sys
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from datetime import UTC, datetime, timedelta
from fnmatch import fnmatchcase as fnmatch
from pathlib import Path
from threading import Event, Thread
from typing import Any, get_args

import pytest
import rclpy
from mabirds_msgs.msg import LearnerStatus
from rclpy._rclpy_pybind11 import RCLError
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup.dashboard.board import Board, Control
from mabirds_bringup.draw.listener import DrawnListener
from mabirds_bringup.draw.node import DrawingNode
from mabirds_bringup.run.declaration import MembershipPublisher
from mabirds_bringup.run.processes import learner_command, player_command
from mabirds_bringup.security.keystore import create_keystore
from mabirds_bringup.security.permissions import Validity
from mabirds_bringup.security.policy import Access, Policy
from mabirds_bringup.watch.drawn_costs import CostsInspectorNode
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_bringup.watch.player_client import NoPlayerError, PlayerClient
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_expert_player.player_node import ExpertPlayerNode
from mabirds_learner.baseline_node import BaselineNode
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.player_services import PLAYER_SERVICES
from mabirds_msgs_py.qos import STATUS_QOS
from mabirds_msgs_py.security import (
    ENABLE,
    KEYSTORE,
    STRATEGY,
    SecurityError,
    make_probe,
    prove_enforcement,
    start_ros,
)

# learner_1 and learner_3 never talk to each other directly.
LINE = [["learner_1", "learner_2"], ["learner_2", "learner_3"]]

DAY = timedelta(days=1)

Start = Callable[[Sequence[str]], Any]
Rights = dict[str, set[str]]


def on_the_graph(observer: Node, process: Access) -> Rights:
    """What a node does, as the ROS graph knows it."""
    look = {
        "publish": observer.get_publisher_names_and_types_by_node,
        "subscribe": observer.get_subscriber_names_and_types_by_node,
        "reply": observer.get_service_names_and_types_by_node,
        "request": observer.get_client_names_and_types_by_node,
    }
    return {right: {name for name, _ in find(process.node, process.namespace)} for right, find in look.items()}


def in_the_policy(process: Access) -> Rights:
    return {right: set(getattr(process, right)) for right in ("publish", "subscribe", "reply", "request")}


def differences(observer: Node, processes: Sequence[Access]) -> list[str]:
    """What a node does without a right to it, and rights that it does not use."""
    present = set(observer.get_node_names_and_namespaces())
    found = [process.enclave for process in processes if (process.node, process.namespace) not in present]
    for process in (process for process in processes if process.enclave not in found):
        real, allowed = on_the_graph(observer, process), in_the_policy(process)
        for right in real:
            unasked = {name for name in real[right] if not any(fnmatch(name, each) for each in allowed[right])}
            unused = {each for each in allowed[right] if not any(fnmatch(name, each) for name in real[right])}
            found += [f"{process.enclave} may not {right} {name}" for name in sorted(unasked)]
            found += [f"{process.enclave} does not {right} {name}" for name in sorted(unused)]
    return found


def settled_differences(nodes: Any, processes: Sequence[Access]) -> list[str]:
    """The differences once discovery has come to rest, at most after thirty seconds."""
    observer, deadline = nodes.plain("observer"), time.monotonic() + 30
    while (found := differences(observer, processes)) and time.monotonic() < deadline:
        nodes.spin_for(0.2)
    return found


@contextmanager
def a_client_that_asks(nodes: Any, player: str = "/expert_player") -> Iterator[None]:
    """Whoever controls the player, after asking for every service of it; what it answers is all the same."""
    fleet = player.rpartition("/")[0]
    client, asked = PlayerClient(player, 3.0, context=nodes.context, namespace=fleet), Event()

    def spin() -> None:
        while not asked.is_set():
            nodes.executor.spin_once(timeout_sec=0.05)

    spinning = Thread(target=spin)
    spinning.start()
    try:
        for service in PLAYER_SERVICES:
            with suppress(NoPlayerError):  # a burst waits for learners
                client.ask(service)
    finally:
        asked.set()
        spinning.join()
    yield
    client.destroy_node()


@contextmanager
def people_who_look(nodes: Any, experiment: Experiment) -> Iterator[None]:
    """An inspector's table, drawings, a picture of them, and a page whose every button has been pressed."""
    for looking in (CostsInspectorNode(lambda *_: None, context=nodes.context), DrawnListener(context=nodes.context)):
        nodes.add(looking)
    nodes.add(DrawingNode(experiment, rate=20.0, context=nodes.context))
    page = Board(experiment, context=nodes.context)
    page.start()
    nodes.spin_until(lambda: page.snapshot.player is not None)
    for control in get_args(Control):
        page.ask(control, **({"rate": 2.0} if control == "set_rate" else {}))
    yield
    page.stop()


@pytest.fixture
def recording(tmp_path: Path) -> Iterator[BagWriter]:
    with BagWriter(tmp_path / "recording") as writer:
        yield writer


@pytest.mark.parametrize("mixing", ["strict", "resilient"])
def test_the_policy_is_what_the_nodes_of_a_network_do(
    make_experiment: Callable[..., Path], nodes: Any, recording: BagWriter, mixing: str
) -> None:
    schedule = {"kind": "slots", "slots": [LINE], "undirected": True}
    file = make_experiment({"mixing": {"kind": mixing}}, learners=3, schedule=schedule)
    experiment = load_experiment(file)
    for name in experiment.learners:
        nodes.learner(file, name)
    nodes.player(file, clock=1.0)
    nodes.add(MonitorNode(experiment, recording, context=nodes.context))
    if mixing == "resilient":
        nodes.add(MembershipPublisher(experiment.learners, context=nodes.context))
    with a_client_that_asks(nodes), people_who_look(nodes, experiment):
        assert settled_differences(nodes, Policy(experiment).processes()) == []


def test_the_policy_of_a_fleet_has_its_namespace(make_experiment: Callable[..., Path], nodes: Any) -> None:
    file = make_experiment(schedule={"kind": "directed_ring"})
    experiment = load_experiment(file)
    for name in experiment.learners:
        nodes.learner(file, f"depot/{name}")
    parameters = [Parameter("experiment", value=str(file)), Parameter("clock", value=1.0)]
    nodes.add(ExpertPlayerNode(context=nodes.context, namespace="/depot", parameter_overrides=parameters))
    processes = Policy(experiment, "/depot").processes()
    with a_client_that_asks(nodes, "/depot/expert_player"), people_who_look(nodes, experiment):
        assert settled_differences(nodes, [one for one in processes if one.node != "monitor"]) == []


def test_the_policy_of_a_central_method_is_what_it_does(
    make_experiment: Callable[..., Path], nodes: Any, recording: BagWriter
) -> None:
    file = make_experiment()
    experiment = load_experiment(file)
    parameters = [Parameter("experiment", value=str(file))]
    nodes.add(BaselineNode(context=nodes.context, namespace="/bics", parameter_overrides=parameters))
    nodes.player(file, baseline="bics", clock=1.0)
    nodes.add(MonitorNode(experiment, recording, names=["bics"], context=nodes.context))
    with a_client_that_asks(nodes), people_who_look(nodes, experiment):
        assert settled_differences(nodes, Policy(experiment, method="bics").processes()) == []


SECURED = {ENABLE: "true", STRATEGY: "Enforce"}
ENCLAVE = ["--enclave", "/learner_1"]


@pytest.fixture
def keystore(make_experiment: Callable[..., Path], tmp_path: Path, ros_domain: int) -> Path:
    """A keystore of an experiment in tmp_path/experiment."""
    now = datetime.now(UTC).replace(microsecond=0)
    processes = Policy(load_experiment(make_experiment())).processes()
    create_keystore(tmp_path / "keystore", processes, ros_domain, Validity(now - DAY, now + DAY))
    return tmp_path / "keystore"


def answer(process: Any) -> str:
    """What a node said that refused to start."""
    output, _ = process.communicate(timeout=20)
    assert process.returncode == 2, output
    assert output.count("error: ") == 1
    assert "Traceback" not in output
    return str(output)


@pytest.mark.parametrize(
    ("settings", "text"),
    [
        ({ENABLE: "True"}, "ROS_SECURITY_ENABLE is 'True', expected true or false"),
        ({STRATEGY: "Enforce"}, "ROS_SECURITY_STRATEGY, --enclave given without ROS_SECURITY_ENABLE"),
        ({ENABLE: "true"}, "ROS_SECURITY_STRATEGY is ''"),
        ({ENABLE: "true", STRATEGY: "enforce"}, "ROS_SECURITY_STRATEGY is 'enforce'"),
        (SECURED, "ROS_SECURITY_KEYSTORE is not set"),
    ],
)
def test_a_node_refuses_settings_with_which_ros_would_go_on_without_security(
    make_experiment: Callable[..., Path],
    start_process: Start,
    monkeypatch: pytest.MonkeyPatch,
    settings: dict[str, str],
    text: str,
) -> None:
    command = learner_command("learner_1", make_experiment())
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    assert text in answer(start_process([*command, *ENCLAVE]))


def test_an_enclave_alone_asks_for_security(make_experiment: Callable[..., Path], start_process: Start) -> None:
    output = answer(start_process([*player_command(make_experiment(), {}), "-e", "/expert_player"]))
    assert "-e given without ROS_SECURITY_ENABLE" in output


def without_security() -> bool:
    """Was the middleware of this Python built without security?"""
    libraries = Path(sys.prefix, "lib").glob("libfastrtps.so.*.*.*")
    return any(b"DDS:Auth:PKI-DH" not in library.read_bytes() for library in libraries)


@pytest.mark.skipif(not without_security(), reason="needs a middleware without security")
@pytest.mark.parametrize("who", ["learner", "player"])
def test_a_middleware_without_security_is_refused(
    keystore: Path, start_process: Start, monkeypatch: pytest.MonkeyPatch, who: str
) -> None:
    for name, value in {**SECURED, KEYSTORE: str(keystore)}.items():
        monkeypatch.setenv(name, value)
    file = keystore.with_name("experiment") / "experiment.yaml"
    command = learner_command("learner_1", file) if who == "learner" else player_command(file, {})
    enclave = "/learner_1" if who == "learner" else "/expert_player"
    output = answer(start_process([*command, "--enclave", enclave]))
    assert "rmw_fastrtps_cpp cannot start with security" in output
    assert "doesn't have the security libraries" in output


def test_security_can_be_taken_back(
    keystore: Path, nodes: Any, start_process: Start, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in {ENABLE: "false", STRATEGY: "Enforce", KEYSTORE: str(keystore)}.items():
        monkeypatch.setenv(name, value)
    heard: list[LearnerStatus] = []
    nodes.plain().create_subscription(LearnerStatus, "/learner_1/status", heard.append, STATUS_QOS)
    file = keystore.with_name("experiment") / "experiment.yaml"
    start_process([*learner_command("learner_1", file), *ENCLAVE])
    nodes.spin_until(lambda: heard)


def test_a_middleware_that_lets_everything_through_is_found_out(context: Context) -> None:
    """Here on one that is really there and really enforces nothing."""
    with pytest.raises(SecurityError, match="let this process publish /mabirds_security_probe"):
        prove_enforcement(context)


def test_a_middleware_that_refuses_what_no_permissions_allow_is_accepted(
    context: Context, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stand-in, since the wheels hold no such middleware; tests/bringup/test_security_dds.py has a real one."""
    create_publisher, made = Node.create_publisher, []

    def strict(node: Node, message_type: type, topic: str, *rest: Any, **options: Any) -> Any:
        made.append(topic)
        if topic != "/parameter_events":
            raise RCLError("not found in allow rule")
        return create_publisher(node, message_type, topic, *rest, **options)

    monkeypatch.setattr(Node, "create_publisher", strict)
    prove_enforcement(context)
    assert made == ["/parameter_events", "/mabirds_security_probe", "/parameter_events"]


def test_what_makes_no_publisher_at_all_is_no_proof(context: Context, monkeypatch: pytest.MonkeyPatch) -> None:
    """As where a process runs out of something just after its first publisher."""
    create_publisher, made = Node.create_publisher, []

    def exhausted(node: Node, message_type: type, topic: str, *rest: Any, **options: Any) -> Any:
        made.append(topic)
        if len(made) > 1:
            raise RCLError("bad alloc")
        return create_publisher(node, message_type, topic, *rest, **options)

    monkeypatch.setattr(Node, "create_publisher", exhausted)
    with pytest.raises(SecurityError, match="makes no publisher at all .bad alloc."):
        prove_enforcement(context)


def test_the_probe_does_what_every_node_may_do_and_nothing_else(context: Context, nodes: Any) -> None:
    """Else permissions for the nodes would not do for the probe."""
    probe = nodes.add(make_probe(context))
    own = on_the_graph(probe, Access("", "/", probe.get_name(), (), (), (), ()))
    assert own == {"publish": {"/parameter_events"}, "subscribe": set(), "reply": set(), "request": set()}


def test_ros_is_shut_down_where_security_is_not_enforced(keystore: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in {**SECURED, KEYSTORE: str(keystore)}.items():
        monkeypatch.setenv(name, value)
    with pytest.raises(SecurityError):
        start_ros(["--ros-args", *ENCLAVE], signal_handler_options=SignalHandlerOptions.NO)
    assert not rclpy.ok()
