"""Hear what an experiment's learners say and write it to files, for a test that is on another network.

watcher.py EXPERIMENT DIRECTORY. ``standing.json``: each learner's newest status, replaced as it changes. When all are
finished: ``history.npz``, each learner's theta and omega by iteration, and ``delivered.json``, who mixed whose.
"""

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from rclpy.executors import SingleThreadedExecutor

from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import History
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.environment import prepare_environment


def watch(file: Path, directory: Path) -> None:
    rclpy.init(args=[])
    with BagWriter(directory / "bag") as recording:
        monitor = MonitorNode(load_experiment(file), recording)
        executor = SingleThreadedExecutor()
        executor.add_node(monitor)
        while not monitor.finished:
            executor.spin_once(timeout_sec=1.0)
            write(directory / "standing.json", standing(monitor))
    np.savez(directory / "history.npz", **stacked(monitor.history()))
    write(directory / "delivered.json", monitor.delivered())


def standing(monitor: MonitorNode) -> dict[str, Any]:
    return {
        name: {"iteration": status.iteration, "waiting_for": list(status.waiting_for)}
        for name, status in monitor.statuses.items()
    }


def stacked(history: History) -> dict[str, Any]:
    return {
        f"{name}.{part}": np.stack([getattr(parameters, part) for parameters in known])
        for name, known in history.items()
        for part in ("theta", "omega")
    }


def write(file: Path, content: Any) -> None:
    """In one step, so that a reader never sees half of it."""
    temporary = file.with_suffix(".new")
    temporary.write_text(json.dumps(content), encoding="utf-8")
    temporary.replace(file)


if __name__ == "__main__":
    prepare_environment()
    watch(Path(sys.argv[1]), Path(sys.argv[2]))
