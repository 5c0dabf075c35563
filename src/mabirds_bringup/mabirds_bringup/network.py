"""Running an experiment as a network of processes: start, watch, stop."""

import signal
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup import processes
from mabirds_bringup.monitor import MonitorNode
from mabirds_bringup.processes import NodeProcess
from mabirds_core.errors import MabirdsError
from mabirds_core.experiment import Experiment
from mabirds_core.simulate import History
from mabirds_msgs_py.bag_writer import BagWriter

PLAYER = "expert_player"
TICK = 0.1
"""Seconds after which the children are looked at, even if no message comes."""


class ProcessDiedError(MabirdsError):
    """A node ended before its time."""


@dataclass(frozen=True)
class Network:
    """The processes of one experiment.

    ``player``: parameters of the player, such as rate. ``order``: names in the order in which to start them;
    the network must not depend on it.
    """

    experiment: Experiment
    file: Path
    directory: Path
    player: Mapping[str, object]
    order: Sequence[str] | None = None

    def run(self, on_tick: Callable[[MonitorNode], None] = lambda _: None) -> History:
        """Run until every learner has learned everything; returns what the monitor received.

        Raises ProcessDiedError when a node ends early. All processes are stopped in any case.
        """
        rclpy.init(args=[], signal_handler_options=SignalHandlerOptions.NO)
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)  # end as on Ctrl-C: nothing left behind
        children: list[NodeProcess] = []
        try:
            with BagWriter(self.directory / "bag") as recording:
                monitor = MonitorNode(self.experiment, recording)
                executor = SingleThreadedExecutor()
                executor.add_node(monitor)
                children.extend(self._start())
                while not monitor.finished:
                    executor.spin_once(timeout_sec=TICK)
                    self._check(children)
                    on_tick(monitor)
                return monitor.history()
        finally:
            processes.stop(children)
            signal.signal(signal.SIGTERM, before)
            rclpy.try_shutdown()

    def _start(self) -> list[NodeProcess]:
        commands = {name: processes.learner_command(name, self.file) for name in self.experiment.learners}
        commands[PLAYER] = processes.player_command(self.file, self.player)
        names = self.order or list(commands)
        return [processes.start(name, commands[name], self.directory / "logs") for name in names]

    def _check(self, children: Sequence[NodeProcess]) -> None:
        for child in children:
            code = child.exit_code
            if code is not None and not (child.name == PLAYER and code == 0):
                raise ProcessDiedError(
                    f"{child.name} ended with exit code {code}; the end of {child.log}:\n"
                    + processes.last_lines(child.log)
                )
