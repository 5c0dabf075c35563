"""How fast learners learn alone, and with a recorder, a live page, an inspector and drawings attached, in turn.

    python benches/attached.py [--iterations 800] [--rounds 6] [--who recorder page inspect] [--json]

The same network of the shipped patrol learns with and without them, in turn, so that both meet the same machine. The
rate is that of learner_1 from its iteration 50 on. Target: with all of them it is at least .8 of that without, in the
median of rounds, as two runs that follow each other meet the same machine.
Where other work runs on the machine, its load is told, and rates say little; then look at the processor time that
learner_1 itself takes for an iteration, which others hardly change. A browser is not started: whoever looks at the page
has one of their own, mostly on another machine. ROS_DOMAIN_ID, where it is set, is kept.
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
from collections.abc import Collection
from contextlib import ExitStack
from pathlib import Path
from typing import Any, NamedTuple

import rclpy
import yaml
from mabirds_msgs.msg import LearnerStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from mabirds_bringup.run.processes import learner_command, player_command, start, stop
from mabirds_core.experiment.file import load_experiment
from mabirds_expert_player.recorder import record
from mabirds_msgs_py.environment import prepare_environment, send_to_this_host
from mabirds_msgs_py.qos import STATUS_QOS

PATROL = Path(__file__).resolve().parents[1] / "ros_ws" / "config" / "patrol.yaml"
FIRST, PATIENCE, TARGET = 50, 300.0, 0.8
WHO = ("recorder", "page", "inspect", "draw")
QUIET = 0.5  # load beforehand, below which no other work counts
RECORDER = """
import sys, rclpy
from pathlib import Path
from rclpy.executors import SingleThreadedExecutor
from mabirds_bringup.run.recording import Recording
from mabirds_bringup.run.network import GLANCE
from mabirds_bringup.watch.monitor import DEPTH, MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.message_loop import MessageLoop
rclpy.init()
with Recording(Path(sys.argv[2])) as recording:
    monitor = MonitorNode(load_experiment(Path(sys.argv[1])), recording)
    loop = MessageLoop(monitor, SingleThreadedExecutor())
    while rclpy.ok():
        loop.glance(GLANCE, DEPTH)
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


class Measured(NamedTuple):
    """Of learner_1: iterations per second, and milliseconds of a processor for each; the machine's load meanwhile."""

    rate: float
    processor_ms: float
    load: float


def measure(file: Path, attached: Collection[str] = ()) -> Measured:
    """Let the network learn once; ``attached``: who looks."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        processes = []
        stack.callback(lambda: stop(processes))
        for name, command in attachments(file, folder).items():
            if name not in attached:
                continue
            processes.append(start(name, command, folder))
        processes += [start(name, learner_command(name, file), folder) for name in ("learner_2", "learner_1")]
        pid = processes[-1].popen.pid
        time.sleep(8.0)  # all have started, and look; what is measured begins later
        processes.append(start("player", player_command(file, {"hz": 2000.0}), folder))
        return measured(pid, load_experiment(file).iterations)


def processor_seconds(pid: int) -> float:
    """What a process has used of processors so far."""
    fields = Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")  # utime and stime of proc(5)


def measured(pid: int, iterations: int) -> Measured:
    """Listen to learner_1, which has this process, until it has learned."""
    rclpy.init()
    node, executor = Node("stopwatch"), SingleThreadedExecutor()
    executor.add_node(node)
    seen: list[tuple[float, float, int]] = []

    def on_status(said: LearnerStatus) -> None:
        seen.append((time.monotonic(), processor_seconds(pid), said.iteration))

    node.create_subscription(LearnerStatus, "/learner_1/status", on_status, STATUS_QOS)
    deadline = time.monotonic() + PATIENCE
    while not seen or seen[-1][-1] <= iterations:
        if time.monotonic() > deadline:
            raise SystemExit(f"learner_1 has not learned within {PATIENCE:g} s: {seen[-1:]}")
        executor.spin_once(timeout_sec=0.1)
    executor.shutdown()
    rclpy.try_shutdown()
    begun, before, first = next(moment for moment in seen if moment[-1] >= FIRST)
    ended, after, last = next(moment for moment in seen if moment[-1] > iterations)
    return Measured((last - first) / (ended - begun), 1e3 * (after - before) / (last - first), os.getloadavg()[0])


def main() -> int:
    """Measure in turn, and compare medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--iterations", type=int, default=800)
    parser.add_argument("--rounds", type=int, default=6)
    parser.add_argument("--who", nargs="+", choices=WHO, default=WHO, help="who is attached; default: all")
    parser.add_argument("--json", action="store_true")
    options = parser.parse_args()
    os.environ.setdefault("ROS_DOMAIN_ID", str(random.randrange(60, 100)))  # noqa: S311 - any free one
    prepare_environment()
    send_to_this_host()  # as `mabirds run` does
    load_before = os.getloadavg()[0]
    results: dict[bool, list[Measured]] = {False: [], True: []}
    with tempfile.TemporaryDirectory() as folder:
        file = longer_patrol(Path(folder), options.iterations)
        for number in range(options.rounds):
            for attached in (False, True) if number % 2 == 0 else (True, False):
                found = measure(file, options.who if attached else ())
                results[attached].append(found)
                tell(f"round {number + 1}, {'attached' if attached else 'alone   '}", found)
    content = summary(results, load_before)
    if options.json:
        print(json.dumps(content))
    return 0


def tell(what: str, found: Measured) -> None:
    """A line on standard error."""
    words = f"{found.rate:6.1f} iterations/s, {found.processor_ms:5.2f} ms of processor each, load {found.load:.1f}"
    print(f"{what}: {words}", file=sys.stderr)


def summary(results: dict[bool, list[Measured]], load_before: float) -> dict[str, Any]:
    """Medians of what was measured, and of each round's ratios; told, and as JSON."""
    for which, name in ((False, "alone   "), (True, "attached")):
        tell(f"medians, {name}", Measured(*map(statistics.median, zip(*results[which], strict=True))))
    rounds = list(zip(results[False], results[True], strict=True))
    rate = statistics.median(attached.rate / alone.rate for alone, attached in rounds)
    processor = statistics.median(alone.processor_ms / attached.processor_ms for alone, attached in rounds)
    print(f"rate attached / alone {rate:.2f}; by processor time {processor:.2f}", file=sys.stderr)
    print(f"load of the machine beforehand: {load_before:.1f}, of {os.cpu_count()} cores", file=sys.stderr)
    if load_before > QUIET:
        print("other work runs here: rates say little; measure again where nothing else does", file=sys.stderr)
    rows = [{"attached": which, **found._asdict()} for which, some in results.items() for found in some]
    target = {"name": "rate_attached", "value": rate, "target": TARGET, "at_most": False, "met": rate >= TARGET}
    machine = {"cores": os.cpu_count(), "threads": 1, "load_before": load_before}
    return {"machine": machine, "results": rows, "rate_by_processor_time": processor, "targets": [target]}


if __name__ == "__main__":
    sys.exit(main())
