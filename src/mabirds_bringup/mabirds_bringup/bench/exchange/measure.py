"""One network of processes: how often it iterates, and the processor time that a learner takes for an iteration."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import rclpy
from mabirds_msgs.msg import LearnerStatus
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.serialization import deserialize_message

from mabirds_bringup.run import processes
from mabirds_bringup.run.processes import NodeProcess
from mabirds_bringup.run.supervisor import ProcessDiedError
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_expert_player.recorder import record
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import nanoseconds
from mabirds_msgs_py.qos import latched

CPUCLOCK_SCHED = 2
"""Of a process's clock: all that the scheduler gave it."""

HZ = 10_000.0
"""Demonstrations a second, more than any learner takes: they are there before they are needed."""

PATIENCE = 120.0
"""Seconds without an iteration after which a network hangs."""

LOOK = 0.02
"""Seconds between two looks, so that looking costs next to nothing."""

DEPTH = 20_000
"""Statuses that wait to be read."""

WARM = 0.2
"""Share of the iterations that is not counted: who starts late has others wait."""


class Reading(NamedTuple):
    """What was seen at one look: the slowest learner's newest iteration, processor seconds of all and of the player."""

    iteration: int
    seconds: float
    player: float = 0.0


@dataclass
class Watch:
    """The statuses of all learners, unread until the end, and the processes' times."""

    readings: list[Reading] = field(default_factory=list)
    peak_megabytes: float = 0.0
    raw: dict[str, list[bytes]] = field(default_factory=dict)

    def listen(self, node: Node, names: Sequence[str]) -> None:
        """Subscribe to all statuses, as bytes."""
        for name in names:
            self.raw[name] = []
            node.create_subscription(
                LearnerStatus, f"/{name}/{topics.STATUS}", self.raw[name].append, latched(DEPTH), raw=True
            )

    def look(self, running: Sequence[int], player: int) -> int:
        """Read the newest status of each; returns the iteration of the slowest. ``player``: its process."""
        newest = [deserialize_message(raw[-1], LearnerStatus).iteration for raw in self.raw.values() if raw]
        slowest = min(newest, default=0) if len(newest) == len(self.raw) else 0
        self.readings.append(Reading(slowest, sum(map(processor_seconds, running)), processor_seconds(player)))
        return slowest

    def milliseconds(self, name: str, first: int) -> np.ndarray[Any, Any]:
        """Between two updates of a learner, shape (iterations,), by the stamps of the first status of each."""
        stamps = dict[int, int]()
        for raw in self.raw[name]:
            status = deserialize_message(raw, LearnerStatus)
            stamps.setdefault(status.iteration, nanoseconds(status.stamp))
        times = [stamps[n] for n in sorted(stamps) if n >= first]
        return np.array([(after - before) / 1e6 for before, after in pairwise(times)])


def processor_seconds(process: int) -> float:
    """User and system time of a process, by its number: what clock_getcpuclockid(3) names on Linux."""
    return time.clock_gettime((~process << 3) | CPUCLOCK_SCHED)


def peak_megabytes(process: int) -> float:
    """The most memory that a process ever had since it began its program, by its number, as Linux says."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="ascii", errors="replace").splitlines()
    return next(1024 * int(line.split()[1]) / 1e6 for line in lines if line.startswith("VmHWM"))


Command = Callable[[str], list[str]]


def leave_alone(process: NodeProcess) -> None:
    """What is done with a process that has been started: nothing."""


def measure(
    file: Path,
    command: Command,
    directory: Path,
    method: str = "",
    on_start: Callable[[NodeProcess], None] = leave_alone,
) -> dict[str, float]:
    """Run a network to its end.

    Parameters
    ----------
    file : Path
        Of the experiment; its bag is recorded.
    command : Command
        That starts a learner's process, by its name.
    directory : Path
        For logs.
    method : str, optional
        A central one, whose process takes the place of all learners.
    on_start : Callable[[NodeProcess], None], optional
        Called with each process as soon as it runs.

    Returns
    -------
    dict[str, float]
        rate: iterations a second; processor_milliseconds: a learner's for an iteration; player_milliseconds: the
        player's, for the demonstrations of all; p50 and p99: milliseconds;
        peak_megabytes: the most that a learner's process ever had; processor_seconds: of all learners, starts included.
    """
    experiment, watch, context = load_experiment(file), Watch(), Context()
    directory.mkdir(parents=True, exist_ok=True)
    rclpy.init(args=[], context=context)
    node, executor = Node("watch", context=context), SingleThreadedExecutor(context=context)
    names = [method] if method else list(experiment.learners)
    watch.listen(node, names)
    executor.add_node(node)
    commands = {name: command(name) for name in names}
    commands["expert_player"] = processes.player_command(file, {"hz": HZ, "baseline": method})
    children = list[NodeProcess]()
    try:
        for name, words in commands.items():
            children.append(processes.start(name, words, directory))
            on_start(children[-1])
        _watch(watch, executor, children, experiment)
    finally:
        processes.stop(children)
        node.destroy_node()
        rclpy.try_shutdown(context=context)
    return figures(watch, experiment)


def _watch(watch: Watch, executor: SingleThreadedExecutor, children: list[NodeProcess], experiment: Experiment) -> None:
    running = [child.popen.pid for child in children[:-1]]
    reached, deadline = 0, time.monotonic() + PATIENCE
    while reached <= experiment.iterations:
        before = reached
        begun = time.monotonic()
        while time.monotonic() - begun < LOOK:
            executor.spin_once(timeout_sec=LOOK)
        for child in children[:-1]:
            if child.exit_code is not None:
                raise ProcessDiedError(f"{child.name} ended: {processes.last_lines(child.log)}")
        reached = watch.look(running, children[-1].popen.pid)
        deadline = time.monotonic() + PATIENCE if reached > before else deadline
        if time.monotonic() > deadline:
            raise ProcessDiedError(f"no iteration after {reached} within {PATIENCE:g} s")
    watch.peak_megabytes = max(map(peak_megabytes, running))


def figures(watch: Watch, experiment: Experiment) -> dict[str, float]:
    """What the watch says of the iterations that count.

    Parameters
    ----------
    watch : Watch
        Of a whole run.
    experiment : Experiment
        Of the run.

    Returns
    -------
    dict[str, float]
        As ``measure`` returns them.
    """
    first = 1 + int(WARM * experiment.iterations)
    counted = [reading for reading in watch.readings if first <= reading.iteration <= experiment.iterations]
    if len({reading.iteration for reading in counted}) < 2:
        counted = watch.readings
    begin, end, end_of_all = counted[0], counted[-1], watch.readings[-1]
    seconds, done = end.seconds - begin.seconds, (end.iteration - begin.iteration) * len(watch.raw)
    times = watch.milliseconds(next(iter(watch.raw)), first)
    statuses = sum(map(len, watch.raw.values())) / (len(watch.raw) * experiment.iterations)
    return {
        "rate": float(1e3 / times.mean()),
        "processor_milliseconds": 1e3 * seconds / done,
        "player_milliseconds": 1e3 * (end.player - begin.player) / (end.iteration - begin.iteration),
        "p50": float(np.percentile(times, 50)),
        "p99": float(np.percentile(times, 99)),
        "statuses_an_iteration": statuses,
        "peak_megabytes": watch.peak_megabytes,
        "processor_seconds": end_of_all.seconds,
    }


def prepared(file: Path) -> Path:
    """Record the demonstrations of an experiment.

    Parameters
    ----------
    file : Path
        Of the experiment.

    Returns
    -------
    Path
        The same.
    """
    experiment = load_experiment(file)
    record(experiment, experiment.demonstrations.bag)
    return file
