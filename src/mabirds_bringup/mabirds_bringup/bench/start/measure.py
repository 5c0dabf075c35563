"""Processor time of processes until they are heard, and of commands until they end."""

import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from statistics import median
from typing import Any

import rclpy
from mabirds_msgs.msg import LearnerStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node

from mabirds_bringup.bench.start.parts import bytecode_kept, commands
from mabirds_bringup.run import processes
from mabirds_bringup.run.processes import NodeProcess
from mabirds_bringup.run.supervisor import ProcessDiedError
from mabirds_msgs_py import topics
from mabirds_msgs_py.qos import latched

LEARNER = "learner_1"
"""Who is started; every shipped experiment has it."""

PATIENCE = 60.0
"""Seconds in which a process must be heard."""

TARGETS = {"help_seconds": 0.25, "learner_times_of_bare": 1.3}

Figures = dict[str, float]


def processor_seconds(process: int) -> float:
    """User and system time of all threads of a process, by its number; Linux tells it in /proc."""
    threads = Path(f"/proc/{process}/task").glob("*/schedstat")
    return sum(int(thread.read_text(encoding="ascii").split()[0]) for thread in threads) / 1e9


def megabytes(process: int) -> float:
    """What of a process is in memory."""
    pages = int(Path(f"/proc/{process}/statm").read_text(encoding="ascii").split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def until_heard(command: Sequence[str], logs: Path) -> Figures:
    """Start a node and wait for its first status.

    Parameters
    ----------
    command : Sequence[str]
        Of the process.
    logs : Path
        Where its output goes.

    Returns
    -------
    dict[str, float]
        seconds of the processor, and megabytes.
    """
    heard, context = list[Any](), Context()
    rclpy.init(args=[], context=context)
    node, executor = Node("start", context=context), SingleThreadedExecutor(context=context)
    node.create_subscription(LearnerStatus, f"/{LEARNER}/{topics.STATUS}", heard.append, latched(1))
    executor.add_node(node)
    child = processes.start(LEARNER, command, logs)
    try:
        _spin(executor, lambda: bool(heard), child)
        return {"seconds": processor_seconds(child.popen.pid), "megabytes": megabytes(child.popen.pid)}
    finally:
        processes.stop([child])
        node.destroy_node()
        rclpy.try_shutdown(context=context)


def _spin(executor: SingleThreadedExecutor, done: Callable[[], bool], child: NodeProcess) -> None:
    deadline = time.monotonic() + PATIENCE
    while not done():
        executor.spin_once(timeout_sec=0.05)
        if child.exit_code is not None or time.monotonic() > deadline:
            raise ProcessDiedError(f"{child.name} was not heard: {processes.last_lines(child.log)}")


def until_ended(command: Sequence[str]) -> float:
    """Processor seconds of a command."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, stdout=subprocess.DEVNULL, check=True)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def compare(files: Mapping[str, Path], repetitions: int, logs: Path) -> Figures:
    """Start everything in turns, so that all meet the same machine.

    Parameters
    ----------
    files : Mapping[str, Path]
        Experiments by their names; the first counts.
    repetitions : int
        Of each; the fastest is told, ratios are medians. One more before them is not told: it compiles.
    logs : Path
        Where output goes.

    Returns
    -------
    dict[str, float]
        Figures by their names.
    """
    with bytecode_kept(logs / "bytecode"):
        rounds = [_round(files, logs) for _ in range(repetitions + 1)][1:]
    figures = {name: min(figures[name] for figures in rounds) for name in rounds[0]}
    first = next(iter(files))
    ratio = median(figures[f"{first}_seconds"] / figures["bare_seconds"] for figures in rounds)
    return {**figures, "learner_times_of_bare": ratio}


def _round(files: Mapping[str, Path], logs: Path) -> Figures:
    """Start everything once."""
    figures = {"help_seconds": until_ended([sys.executable, "-m", "mabirds_bringup", "--help"])}
    steps = commands(next(iter(files.values())), LEARNER)
    figures |= {f"to_{step}_seconds": until_ended(command) for step, command in steps.items()}
    nodes = {name: processes.learner_command(LEARNER, file) for name, file in files.items()}
    nodes = {"bare": processes.command_of("mabirds_bringup.bench.start.bare", LEARNER), **nodes}
    for name, command in nodes.items():
        figures |= {f"{name}_{key}": value for key, value in until_heard(command, logs).items()}
    return figures


def targets(results: Figures) -> list[dict[str, Any]]:
    """Compare with what is asked for.

    Parameters
    ----------
    results : dict[str, float]
        Figures by their names.

    Returns
    -------
    list[dict[str, Any]]
        name, value, target, at_most, met.
    """
    return [
        {"name": name, "value": results[name], "target": limit, "at_most": True, "met": results[name] <= limit}
        for name, limit in TARGETS.items()
    ]
