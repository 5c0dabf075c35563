"""How fast learners learn alone, and with a recorder, a live page, an inspector and drawings attached, in turn.

    python benches/attached.py [--iterations 400] [--rounds 3] [--json]

The same network of the shipped patrol learns with and without them, in turn, so that both meet the same machine. The
rate is that of learner_1 from its iteration 50 on. Target: the median with all of them is at least .8 of that without.
A browser is not started: whoever looks at the page has one of their own, mostly on another machine.
"""

import argparse
import json
import os
import random
import socket
import statistics
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path

import rclpy
import yaml
from mabirds_msgs.msg import LearnerStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from mabirds_bringup.run.processes import learner_command, player_command, start, stop
from mabirds_core.experiment.file import load_experiment
from mabirds_expert_player.recorder import record
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.qos import STATUS_QOS

PATROL = Path(__file__).resolve().parents[1] / "ros_ws" / "config" / "patrol.yaml"
FIRST, PATIENCE, TARGET = 50, 300.0, 0.8
RECORDER = """
import sys, rclpy
from pathlib import Path
from rclpy.executors import SingleThreadedExecutor
from mabirds_bringup.run.recording import Recording
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.message_loop import MessageLoop
rclpy.init()
with Recording(Path(sys.argv[2])) as recording:
    monitor = MonitorNode(load_experiment(Path(sys.argv[1])), recording)
    loop = MessageLoop(monitor, SingleThreadedExecutor())
    while rclpy.ok():
        loop.spin_once(0.1)
"""
"""What `mabirds run` records with."""


def longer_patrol(folder: Path, iterations: int) -> Path:
    """The shipped experiment with more demonstrations, and its bag."""
    settings = yaml.safe_load(PATROL.read_text(encoding="utf-8"))
    settings["iterations"] = iterations
    settings["demonstrations"] |= {"bag": "bag", "per_learner": iterations}
    file = folder / "experiment.yaml"
    file.write_text(yaml.safe_dump(settings), encoding="utf-8")
    experiment = load_experiment(file)
    record(experiment, experiment.demonstrations.bag)
    return file


def free_port() -> int:
    """A port that nobody serves."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def attachments(file: Path, folder: Path) -> dict[str, list[str]]:
    """Command lines of those who look."""
    mabirds = [sys.executable, "-m", "mabirds_bringup"]
    return {
        "recorder": [sys.executable, "-c", RECORDER, str(file), str(folder)],
        "page": [*mabirds, "dashboard", str(file), "--port", str(free_port())],
        "inspect": [sys.executable, "-c", f"import pty; pty.spawn({[*mabirds, 'inspect']!r})"],  # its table
        "draw": [*mabirds, "draw", str(file)],
    }


def measure(file: Path, *, attached: bool) -> float:
    """Iterations per second of learner_1."""
    os.environ["ROS_DOMAIN_ID"] = str(random.randrange(60, 100))  # noqa: S311 - any free one
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        processes = []
        stack.callback(lambda: stop(processes))
        for name, command in attachments(file, folder).items() if attached else ():
            processes.append(start(name, command, folder))
        processes += [start(name, learner_command(name, file), folder) for name in ("learner_1", "learner_2")]
        time.sleep(8.0)  # all have started, and look; what is measured begins later
        processes.append(start("player", player_command(file, {"hz": 2000.0}), folder))
        return rate_of(load_experiment(file).iterations)


def rate_of(iterations: int) -> float:
    """Listen to learner_1 until it has learned."""
    rclpy.init()
    node, executor = Node("stopwatch"), SingleThreadedExecutor()
    executor.add_node(node)
    seen: list[tuple[float, int]] = []
    node.create_subscription(
        LearnerStatus, "/learner_1/status", lambda said: seen.append((time.monotonic(), said.iteration)), STATUS_QOS
    )
    deadline = time.monotonic() + PATIENCE
    while not seen or seen[-1][1] <= iterations:
        if time.monotonic() > deadline:
            raise SystemExit(f"learner_1 has not learned within {PATIENCE:g} s: {seen[-1:]}")
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    rclpy.try_shutdown()
    begun, first = next(moment for moment in seen if moment[1] >= FIRST)
    ended, last = next(moment for moment in seen if moment[1] > iterations)
    return (last - first) / (ended - begun)


def main() -> int:
    """Measure in turn, and compare medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=400)
    parser.add_argument("--rounds", type=int, default=3)
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    prepare_environment()
    results = []
    with tempfile.TemporaryDirectory() as folder:
        file = longer_patrol(Path(folder), options.iterations)
        for number in range(options.rounds):
            for attached in (False, True):
                rate = measure(file, attached=attached)
                results.append({"round": number + 1, "attached": attached, "iterations_per_second": rate})
                print(f"round {number + 1}, {'attached' if attached else 'alone'}: {rate:.1f}/s", file=sys.stderr)
    medians = {
        attached: statistics.median(one["iterations_per_second"] for one in results if one["attached"] is attached)
        for attached in (False, True)
    }
    ratio = medians[True] / medians[False]
    target = {"name": "rate_attached", "value": ratio, "target": TARGET, "at_most": False, "met": ratio >= TARGET}
    machine = {"cores": os.cpu_count(), "threads": 1}
    print(f"alone {medians[False]:.1f}/s, attached {medians[True]:.1f}/s: {ratio:.2f}", file=sys.stderr)
    if options.json:
        print(json.dumps({"machine": machine, "results": results, "targets": [target]}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
