"""`mabirds inspect` as a process: data on standard output, talk on standard error, the newest and not an older one."""

import csv
import io
import json
import os
import re
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from mabirds_msgs.msg import EdgeSchedule, FeatureNames, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy._rclpy_pybind11 import RCLError
from rclpy.node import Node
from std_msgs.msg import String

from mabirds_bringup.run.processes import learner_command, player_command, start, stop
from mabirds_bringup.topics.listening import Listening, listener_node
from mabirds_bringup.topics.parameters import Services
from mabirds_bringup.topics.plain import InspectionError, field_of, fill, flat, named, plain
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.names import ParameterNames
from mabirds_msgs_py.conversion import schedule_message
from mabirds_msgs_py.qos import STATUS_QOS, latched

MABIRDS = [sys.executable, "-m", "mabirds_bringup", "inspect"]


def inspect(*arguments: object) -> "subprocess.CompletedProcess[str]":
    command = [*MABIRDS, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def data(*arguments: object) -> str:
    done = inspect(*arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def finished(
    shared_ros_domain: int, make_shared_experiment: Callable[..., Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Path]:
    """A network that has learned all of its demonstrations and stays; its ROS domain is that of the module."""
    file, logs = make_shared_experiment(iterations=30), tmp_path_factory.mktemp("logs")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(shared_ros_domain))
        nodes = [start(name, learner_command(name, file), logs) for name in ("learner_1", "learner_2")]
        nodes.append(start("player", player_command(file, {"hz": 50.0}), logs))
        try:
            deadline = time.monotonic() + 60
            while not all("demonstrations learned" in node.log.read_text() for node in nodes[:2]):
                assert time.monotonic() < deadline
                time.sleep(0.2)
            yield file
        finally:
            stop(nodes)


@pytest.fixture
def network(finished: Path, shared_ros_domain: int, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("ROS_DOMAIN_ID", str(shared_ros_domain))
    return finished


def test_once_shows_the_newest_of_a_finished_network(network: Path) -> None:
    done = inspect("--once", "--json", "--top", 2)
    content = json.loads(done.stdout)
    for learner in content["learners"].values():
        assert (learner["state"], learner["iteration"], learner["parameters"]["iteration"]) == ("finished", 31, 31)
        assert "expert_" in learner["parameters"]["costliest"][0]["feature"]
    words = data("--once")
    assert len(words.splitlines()) >= 4
    assert "feature " not in words
    assert re.search(r"^/learner_1 iteration 31: finished", words, re.MULTILINE)


def test_a_topic_is_echoed_by_name_in_three_forms(network: Path) -> None:
    echo = ("echo", "/learner_1/parameters", "--once")
    content = json.loads(data(*echo, "--format", "jsonl"))
    assert content["iteration"] == 31
    assert "expert_1 in (0, 1)" in content["omega"]
    assert "expert_1 in (0, 1) going south" in content["theta"]
    (row,) = csv.DictReader(io.StringIO(data(*echo, "--format", "csv", "--field", "omega")))
    assert {name: float(value) for name, value in row.items()} == content["omega"]
    document = next(yaml.safe_load_all(data(*echo)))
    assert document == content
    assert (
        json.loads(data(*echo, "--field", "omega.sharing a cell").split("\n")[0]) == content["omega"]["sharing a cell"]
    )


def test_lists_rates_and_ends_of_topics(network: Path) -> None:
    topics = json.loads(data("list", "--json"))
    assert topics["/learner_1/feature_names"] == "mabirds_msgs/msg/FeatureNames"
    assert "/learner_2/learner" in data("list", "--nodes").split()
    assert "/learner_1/fetch_parameters mabirds_msgs/srv/FetchParameters" in data("list", "--services").splitlines()
    rate = json.loads(data("hz", "/learner_1/status", "--seconds", 4, "--json"))
    assert 0.7 < rate["hz"] < 1.4  # a finished learner says once a second that it lives
    width = json.loads(data("bw", "/learner_1/status", "--seconds", 3, "--json"))
    assert 300 < width["mean_bytes"] < 1500
    assert width["bytes_per_second"] == pytest.approx(width["messages"] * width["mean_bytes"] / 3)
    ends = json.loads(data("info", "/learner_1/parameters", "--json"))
    assert [end["node"] for end in ends["publishers"]] == ["/learner_1/learner"]
    assert ends["publishers"][0]["durability"] == "transient_local"
    assert {end["node"] for end in ends["subscribers"]} == {"/learner_2/learner"}


def test_parameters_and_services_of_nodes(network: Path) -> None:
    node = "/learner_1/learner"
    assert json.loads(data("param", "get", node, "status_period")) == 1.0
    assert yaml.safe_load(data("param", "dump", node))[node]["ros__parameters"]["experiment"] == str(network)
    refused = inspect("param", "set", node, "status_period", "0.5")
    assert (refused.returncode, refused.stdout) == (2, "")
    assert "refuses status_period" in refused.stderr
    answer = json.loads(data("call", "/learner_1/fetch_parameters", "{iteration: 2}", "--json"))
    assert answer["found"] is True
    assert answer["parameters"]["iteration"] == 2
    wrong = inspect("call", "/learner_1/fetch_parameters", "{iterations: 2}")
    assert wrong.returncode == 2
    assert "field iterations: expected one of iteration" in wrong.stderr


def test_output_ends_with_its_reader_and_without_a_word(network: Path) -> None:
    command = [*MABIRDS, "echo", "/learner_1/status", "--format", "jsonl"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    assert process.stdout
    assert process.stderr
    assert json.loads(process.stdout.readline())["learner"] == "learner_1"
    process.stdout.close()
    assert process.wait(timeout=30) == 0
    assert process.stderr.read() == ""
    process.stderr.close()


def test_nobody_there_is_said_on_standard_error() -> None:
    for arguments in (("echo", "/nothing", "--once", "--timeout", 1), ("param", "dump", "/nobody", "--timeout", 1)):
        done = inspect(*arguments)
        assert (done.returncode, done.stdout) == (4, "")
        assert "error: " in done.stderr


def test_a_late_joiner_is_shown_the_newest_of_what_is_kept(make_experiment: Callable[..., Path], nodes: Any) -> None:
    """A publisher that keeps hundreds of statuses sends all of them to whoever comes late."""
    schedule = load_experiment(make_experiment(learners=1)).edge_schedule
    node = nodes.plain()
    statuses = node.create_publisher(LearnerStatus, "/learner_1/status", latched(512))
    parameters = node.create_publisher(ParametersMessage, "/learner_1/parameters", latched(64))
    names = node.create_publisher(FeatureNames, "/learner_1/feature_names", STATUS_QOS)
    edges = node.create_publisher(EdgeSchedule, "/learner_1/edge_schedule", STATUS_QOS)
    edges.publish(schedule_message(schedule))
    names.publish(FeatureNames(omega=["a wall"]))
    for n in range(1, 501):
        state = LearnerStatus.FINISHED if n == 500 else LearnerStatus.LEARNING
        statuses.publish(LearnerStatus(learner="learner_1", iteration=n, state=state, metric_values=[0.0]))
        parameters.publish(ParametersMessage(learner="learner_1", iteration=n, theta=[1.0], omega=[-float(n)]))
    process = subprocess.Popen([*MABIRDS, "--once", "--json"], stdout=subprocess.PIPE, text=True)
    nodes.spin_until(lambda: process.poll() is not None)
    content = json.loads(process.communicate()[0])["learners"]["/learner_1"]
    assert (content["iteration"], content["state"], content["parameters"]["iteration"]) == (500, "finished", 500)
    assert content["parameters"]["costliest"] == [{"feature": "a wall", "cost": 500.0}]
    process = subprocess.Popen(
        [*MABIRDS, "echo", "/learner_1/status", "--once", "--field", "iteration"], stdout=subprocess.PIPE, text=True
    )
    nodes.spin_until(lambda: process.poll() is not None)
    assert process.communicate()[0].split()[0] == "500"


@pytest.mark.parametrize("end", ["subscription", "client"])
def test_what_permissions_refuse_is_said(nodes: Any, monkeypatch: pytest.MonkeyPatch, end: str) -> None:
    """A stand-in, since the wheels hold no middleware with security."""
    speaker, listener = nodes.plain("speaker"), nodes.add(listener_node(context=nodes.context))
    speaker.create_publisher(String, "/secret", 1)
    listening = Listening(listener, nodes.executor, 5.0)
    look = {
        "subscription": lambda: listening.newest("/secret"),
        "client": lambda: Services(listener, listening).get("/speaker", ["rate"]),
    }

    def refuse(*_: Any, **__: Any) -> None:
        raise RCLError("/secret not found in allow rule")

    monkeypatch.setattr(Node, f"create_{end}", refuse)
    with pytest.raises(InspectionError, match="the middleware refuses it .*allow rule.*; with security on"):
        look[end]()


def test_plain_values_and_back() -> None:
    message = LearnerStatus(iteration=3, metric_names=["a"], metric_values=[float("nan")], waiting_for=["x"])
    content = plain(message)
    assert content["metric_values"] == [None]
    assert json.dumps(content, allow_nan=False)
    again = fill(LearnerStatus(), {**content, "metric_values": [2.0]})
    assert (again.iteration, list(again.metric_values), again.waiting_for) == (3, [2.0], ["x"])
    assert dict(flat({"a": [1, {"b": 2}]})) == {"a.0": 1, "a.1.b": 2}
    assert named({"theta": [1.0], "omega": [2.0, 3.0]}, ParameterNames(("t",), ("only one",))) == {
        "theta": {"t": 1.0},
        "omega": [2.0, 3.0],
    }
    with pytest.raises(InspectionError, match="there is no 'c' here; it has a, b"):
        field_of({"a": 1, "b": 2}, "c")
    with pytest.raises(InspectionError, match="field iteration: 'three' is no uint64"):
        fill(LearnerStatus(), {"iteration": "three"})


TABLE = """
import pty, signal
signal.signal(signal.SIGHUP, signal.SIG_DFL)  # the command ends with its terminal, also where nohup began the tests
pty.spawn(["bash", "-c", "stty cols 60 rows 40; exec {} -m mabirds_bringup inspect"])
"""


def test_a_terminal_of_60_columns_has_a_table(network: Path) -> None:
    process = subprocess.Popen(
        [sys.executable, "-c", TABLE.format(sys.executable)], stdout=subprocess.PIPE, stdin=subprocess.DEVNULL
    )
    assert process.stdout
    screen, lines, deadline = "", [""], time.monotonic() + 30
    # statuses and parameters come on topics of their own, in any order
    awaited = ("apart at iteration 31", "learner_1 +finished +30 ", "learner_2 +finished +30 ")
    while not all(any(re.search(content, line) for line in lines) for content in awaited):
        assert time.monotonic() < deadline, screen
        screen += os.read(process.stdout.fileno(), 65536).decode(errors="replace")
        lines = [re.sub(r"\x1b\[[0-9;?]*[A-Za-z]", "", line) for line in re.split(r"[\r\n]+", screen)]
    process.terminate()
    process.communicate()
    assert max(map(len, lines)) <= 60
    assert "no player" in lines
