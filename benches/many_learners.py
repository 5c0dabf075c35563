"""Many learner processes on one machine: how long until all are there, what they need, how fast they are together.

Example: .venv/bin/python benches/many_learners.py --learners 32 --json
"""

import json
import os
import platform
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import psutil
import typer
import yaml

from mabirds_bringup.console import console, guarded_output
from mabirds_bringup.run.network import Network
from mabirds_bringup.run.supervisor import Supervisor
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_expert_player.recorder import record
from mabirds_msgs_py.environment import prepare_environment

PATROL = Path(__file__).resolve().parents[1] / "ros_ws" / "config" / "patrol.yaml"
SHARED_MEMORY = Path("/dev/shm")  # noqa: S108 - where Fast DDS puts segments and locks of its own, if it may


@dataclass
class Watch:
    """Notes at every tick the time, when all were there, and half-way the memory they take."""

    experiment: Experiment
    start: float = field(default_factory=time.monotonic)
    seconds: float = 0.0
    all_there: float = 0.0
    megabytes: list[float] = field(default_factory=list)
    restarts: int = 0

    def __call__(self, monitor: MonitorNode, supervisor: Supervisor, news: Sequence[str]) -> None:
        """Look, while the network runs."""
        self.seconds = time.monotonic() - self.start
        self.restarts += len(news)
        if not self.all_there and len(monitor.statuses) == len(self.experiment.learners):
            self.all_there = self.seconds
        newest = [max(by_iteration, default=0) for by_iteration in monitor.parameters.values()]
        if not self.megabytes and min(newest) > self.experiment.iterations // 2:
            running = [child.process for child in supervisor.children.values() if child.process]
            pids = [process.popen.pid for process in running if process.exit_code is None]  # the player may have ended
            self.megabytes = [psutil.Process(pid).memory_info().rss / 1e6 for pid in pids]


def experiment_of(learners: int, iterations: int, directory: Path) -> Path:
    """The shipped patrol experiment with so many learners on an alternating ring, and its demonstrations."""
    content = yaml.safe_load(PATROL.read_text(encoding="utf-8"))
    content["learners"] = [f"learner_{number}" for number in range(1, learners + 1)]
    content |= {"schedule": {"kind": "alternating"}, "iterations": iterations, "closing_rounds": 0}
    content["demonstrations"] |= {"bag": "demonstrations", "per_learner": iterations}
    file = directory / "many.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    experiment = load_experiment(file)
    record(experiment, experiment.demonstrations.bag)
    return file


def measure(learners: int, iterations: int, directory: Path) -> dict[str, Any]:
    """Run them, and say what was seen."""
    file = experiment_of(learners, iterations, directory)
    experiment, before = load_experiment(file), set(SHARED_MEMORY.glob("*fastrtps*"))
    (directory / "logs").mkdir()
    watch = Watch(experiment)
    result = Network(experiment, file, directory, {"hz": 1000.0}).run(watch)
    return {
        "learners": learners,
        "iterations": min(map(len, result.history.values())) - 1,
        "seconds_until_all_are_there": watch.all_there,
        "seconds": watch.seconds,
        "iterations_a_second": iterations / (watch.seconds - watch.all_there),
        "megabytes_a_process": sum(watch.megabytes) / len(watch.megabytes),
        "megabytes": sum(watch.megabytes),
        "deaths": watch.restarts,
        "shared_memory_files_left": len(set(SHARED_MEMORY.glob("*fastrtps*")) - before),
    }


def main(
    learners: Annotated[int, typer.Option(help="Learner processes.", min=2)] = 32,
    iterations: Annotated[int, typer.Option(help="Updates of each.", min=2)] = 20,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,  # noqa: FBT002
) -> None:
    """Start so many learners, let all of them learn, and report."""
    prepare_environment()
    with guarded_output() as stdout, tempfile.TemporaryDirectory() as directory:
        results = measure(learners, iterations, Path(directory))
        machine = {"cores": os.cpu_count(), "python": platform.python_version(), "rclpy": version("ros-rclpy")}
        for name, value in results.items():
            console.print(f"{name}: {value:.3g}" if isinstance(value, float) else f"{name}: {value}")
        if as_json:
            print(json.dumps({"machine": machine, "results": results}), file=stdout)


if __name__ == "__main__":
    typer.run(main)
