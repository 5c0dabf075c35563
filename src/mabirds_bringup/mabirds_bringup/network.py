"""Running an experiment as a network of processes: start, watch, stop."""

import secrets
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup import processes
from mabirds_bringup.monitor import MonitorNode
from mabirds_bringup.processes import NodeProcess
from mabirds_core.errors import MabirdsError
from mabirds_core.experiment import Experiment
from mabirds_core.schedule import Delivered
from mabirds_core.simulate import History
from mabirds_msgs_py.bag_writer import BagWriter

PLAYER = "expert_player"
"""Name of the player among the processes."""

GRACE = 5.0
"""Seconds in which the monitor hears what the player had heard when it left."""

TICK = 0.1
"""Seconds after which the children are looked at, even if no message comes."""


class ProcessDiedError(MabirdsError):
    """A node ended before its time."""


class NetworkResult(NamedTuple):
    """What the monitor received: theta and omega of all iterations, and who mixed whose."""

    history: History
    delivered: Delivered


@dataclass(frozen=True)
class Network:
    """The processes of one experiment.

    ``player``: parameters of the player, such as rate. ``order``: names in the order in which to start them; the
    network must not depend on it. ``method``: a central method that learns in the learners' place.
    """

    experiment: Experiment
    file: Path
    directory: Path
    player: Mapping[str, object]
    order: Sequence[str] | None = None
    method: str | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """Who learns."""
        return (self.method,) if self.method else self.experiment.learners

    def run(self, on_tick: Callable[[MonitorNode], None] = lambda _: None) -> NetworkResult:
        """Run until every learner has learned everything.

        Raises ProcessDiedError when a node ends early. All processes are stopped in any case.
        """
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)  # end as on Ctrl-C: nothing left behind
        children: list[NodeProcess] = []
        try:
            with BagWriter(self.directory / "bag", keep=True) as recording:
                monitor = MonitorNode(self.experiment, recording, self._run, self.names)
                executor = SingleThreadedExecutor()
                executor.add_node(monitor)
                children.extend(self._start())
                while not monitor.finished:
                    executor.spin_once(timeout_sec=TICK)
                    self._check(children, lambda: _hear_out(executor, monitor))
                    on_tick(monitor)
                return NetworkResult(monitor.history(), monitor.delivered())
        finally:
            processes.stop(children)
            signal.signal(signal.SIGTERM, before)
            rclpy.try_shutdown()

    @cached_property
    def _run(self) -> str:
        """A name that no other run has."""
        return f"{self.directory.name}-{secrets.token_hex(4)}"

    def _start(self) -> Iterator[NodeProcess]:
        """Start one node after the other; lazily, so that the caller knows each one even if a later one fails."""
        command = processes.central_command if self.method else processes.learner_command
        commands = {name: command(name, self.file, self._run) for name in self.names}
        player = {**self.player, "run": self._run, "central": self.method or ""}
        commands[PLAYER] = processes.player_command(self.file, player)
        names = self.order or list(commands)
        for name in names:
            yield processes.start(name, commands[name], self.directory / "logs")

    def _check(self, children: Sequence[NodeProcess], all_learned: Callable[[], bool]) -> None:
        """Raise ProcessDiedError where a node has ended, unless it is the player and all is learned."""
        for child in children:
            code = child.exit_code
            if code is not None and not (child.name == PLAYER and code == 0 and all_learned()):
                raise ProcessDiedError(
                    f"{child.name} ended with exit code {code}; the end of {child.log}:\n"
                    + processes.last_lines(child.log)
                )


def _hear_out(executor: SingleThreadedExecutor, monitor: MonitorNode) -> bool:
    """Has every learner learned everything? Waits a moment for messages that are still on their way."""
    deadline = time.monotonic() + GRACE
    while not monitor.all_learned and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=TICK)
    return monitor.all_learned
