"""What one learner's process costs: memory, idle processor time, time per iteration, in a shipped experiment.

Example: .venv/bin/python benches/learner_process.py --experiment discrete --json
"""

import json
import os
import platform
import tempfile
import time
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import psutil
import rclpy
import typer
from mabirds_msgs.msg import LearnerStatus
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from mabirds_bringup.console import console, guarded_output
from mabirds_bringup.run import processes
from mabirds_bringup.run.supervisor import ProcessDiedError
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.qos import latched

CONFIG = Path(__file__).resolve().parents[1] / "ros_ws" / "config"
IDLE_SECONDS = 10.0
MOST_IDLE = 0.05
"""Share of a core."""
MOST_MEGABYTES = {"patrol": 110.0, "discrete": 110.0, "drones": 400.0}
"""At any time."""


class Listener(Node):
    """Collects the statuses of learner_1."""

    def __init__(self) -> None:
        super().__init__("listener")
        self.statuses: list[LearnerStatus] = []
        self.create_subscription(LearnerStatus, "/learner_1/status", self.statuses.append, latched(1000))


def measure(file: Path, logs: Path) -> dict[str, float]:
    """Start the learners of an experiment, let them idle, then let them learn everything."""
    rclpy.init(args=[])
    listener, executor = Listener(), SingleThreadedExecutor()
    executor.add_node(listener)

    names = load_experiment(file).learners
    nodes = [processes.start(name, processes.learner_command(name, file), logs) for name in names]

    def spin_until(condition: Callable[[], Any]) -> None:
        while not condition():
            executor.spin_once(timeout_sec=0.1)
            for node in nodes:
                if node.exit_code:
                    raise ProcessDiedError(f"{node.name} ended: {processes.last_lines(node.log)}")

    try:
        learner, start = psutil.Process(nodes[0].popen.pid), time.monotonic()
        spin_until(lambda: listener.statuses)
        ready = time.monotonic() - start
        before, start = cpu_seconds(learner), time.monotonic()
        spin_until(lambda: time.monotonic() - start > IDLE_SECONDS)
        idle = (cpu_seconds(learner) - before) / (time.monotonic() - start)
        nodes.append(processes.start("expert_player", processes.player_command(file, {"hz": 1000.0}), logs))
        spin_until(lambda: listener.statuses[-1].state == LearnerStatus.FINISHED)
        return {
            "start_seconds": ready,
            "idle_share_of_a_core": idle,
            "resident_megabytes": learner.memory_info().rss / 1e6,
            "most_megabytes": most_megabytes(learner),
            "iteration_seconds": median([iteration_seconds(status) for status in listener.statuses]),
        }
    finally:
        processes.stop(nodes)
        rclpy.try_shutdown()


def most_megabytes(process: psutil.Process) -> float:
    """The most that was resident at any time."""
    status = Path(f"/proc/{process.pid}/status").read_text(encoding="ascii")
    return int(status.split("VmHWM:")[1].split()[0]) * 1024 / 1e6


def cpu_seconds(process: psutil.Process) -> float:
    """User and system time of a process."""
    times = process.cpu_times()
    return float(times.user + times.system)


def iteration_seconds(status: LearnerStatus) -> float | None:
    """Time of the newest update, if there was one."""
    metrics = dict(zip(status.metric_names, status.metric_values, strict=True))
    return metrics.get("iteration_seconds")


def median(values: list[float | None]) -> float:
    """Median of those that are there."""
    numbers = sorted(value for value in values if value is not None)
    return numbers[len(numbers) // 2]


def main(
    experiment: Annotated[str, typer.Option(help=f"One of {', '.join(MOST_MEGABYTES)}.")] = "patrol",
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,  # noqa: FBT002
) -> None:
    """Measure the process of an experiment's first learner."""
    if experiment not in MOST_MEGABYTES:
        raise typer.BadParameter(f"{experiment}: expected one of {', '.join(MOST_MEGABYTES)}")
    prepare_environment()
    with guarded_output() as stdout, tempfile.TemporaryDirectory() as logs:
        results = measure(CONFIG / f"{experiment}.yaml", Path(logs))
        limits = {"most_megabytes": MOST_MEGABYTES[experiment], "idle_share_of_a_core": MOST_IDLE}
        targets = [
            {"name": name, "value": results[name], "target": target, "met": results[name] <= target}
            for name, target in limits.items()
        ]
        machine = {
            "system": platform.platform(),
            "cores": os.cpu_count(),
            "python": platform.python_version(),
            "rclpy": version("ros-rclpy"),
            "threads per process": 1,
        }
        console.print(machine, results, targets, sep="\n")
        if as_json:
            print(json.dumps({"machine": machine, "results": results, "targets": targets}), file=stdout)


if __name__ == "__main__":
    typer.run(main)
