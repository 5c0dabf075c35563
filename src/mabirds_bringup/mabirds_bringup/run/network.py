"""Running an experiment as a network of processes: start, watch, stop."""

import secrets
import signal
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import rclpy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from mabirds_bringup.run import processes
from mabirds_bringup.run.deafness import Deafness
from mabirds_bringup.run.farewell import SHUTDOWN_TIMEOUT, Farewell
from mabirds_bringup.run.processes import PLAYER
from mabirds_bringup.run.recording import Recording
from mabirds_bringup.run.supervisor import Supervisor
from mabirds_bringup.watch.monitor import DEPTH, OTHER_EXPERIMENT, MonitorNode
from mabirds_bringup.watch.watched_history import DIRECTORY
from mabirds_core.consensus.schedule import DeliveredEdges
from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_msgs_py.addresses import AddressWatch
from mabirds_msgs_py.clock_watch import SetBack, waking
from mabirds_msgs_py.declaration_key import make_key, read_key
from mabirds_msgs_py.environment import send_to_this_host
from mabirds_msgs_py.message_loop import MessageLoop
from mabirds_msgs_py.security import enclave_arguments, start_ros

KEY = "declaration.key"
"""Name of the file with the key of declarations, in a run directory."""

TICK = 0.1
"""Seconds of one turn while nobody learns."""

GLANCE = 0.05
"""Seconds for which messages gather before they are taken, and between two looks at the children."""


OnTick = Callable[[MonitorNode, Supervisor, Sequence[str]], None]
"""What is called at every tick of a run, with news of processes that died."""


def _nothing(monitor: MonitorNode, supervisor: Supervisor, news: Sequence[str]) -> None:
    """Do nothing at a tick."""


class HostMovedError(MabirdsError):
    """The host has other addresses than when this process began, which can hear nobody from there.

    Fast DDS looks at a host's addresses once in a process: another participant would not do.
    """


class DeafSupervisorError(HostMovedError):
    """A supervisor does not hear a learner that others hear: its participant has to be made anew."""


class NetworkResult(NamedTuple):
    """What the monitor received: theta and omega of all iterations, and who mixed whose.

    ``mass_residual``: of resilient mode, see ``MonitorNode.mass_residual``. ``departed``: without whom it went on.
    """

    history: History
    delivered: DeliveredEdges
    mass_residual: float | None
    departed: Sequence[str]


@dataclass(frozen=True)
class Network:
    """The processes of one experiment.

    ``player``: parameters of the player, such as rate. ``order``: names in the order in which to start them; the
    network must not depend on it. ``method``: a central method that learns in the learners' place. ``restarts``: how
    often a node that died is started again. ``only``: the nodes that belong on this host, where others run the rest
    of the experiment under the same ``run`` name. ``bag_digest``: of the demonstrations that must be played; "": any.
    """

    experiment: Experiment
    file: Path
    directory: Path
    player: Mapping[str, object]
    order: Sequence[str] | None = None
    method: str | None = None
    restarts: int = 0
    only: Sequence[str] = ()
    shared_run: str = ""
    bag_digest: str = ""

    def __post_init__(self) -> None:
        """Raise ExperimentError for a node that the experiment does not have."""
        if strangers := sorted(set(self.only) - {*self.names, PLAYER}):
            raise ExperimentError(f"--only {strangers[0]}: expected some of {[*self.names, PLAYER]}")

    @property
    def names(self) -> tuple[str, ...]:
        """Names of those who learn."""
        return (self.method,) if self.method else self.experiment.learners

    def run(self, on_tick: OnTick = _nothing) -> NetworkResult:
        """Run until every learner has learned everything.

        ``on_tick`` is given the monitor, the supervisor and news of processes that died. Raises ProcessDiedError when
        a node ends early and may not be started again, and ExperimentError when another host of the same run has
        another experiment. All processes are stopped in any case.
        """
        # Before the participant is made, which keeps addresses that there are.
        addresses, clock = AddressWatch(), SetBack()
        if not self.only:
            send_to_this_host()
        start_ros(["--ros-args", *enclave_arguments("/monitor")], signal_handler_options=SignalHandlerOptions.NO)
        before = signal.signal(signal.SIGTERM, signal.default_int_handler)  # end as on Ctrl-C: nothing left behind
        supervisor = Supervisor(self._commands(), self.directory / "logs", self.restarts, self._optional)
        try:
            with Recording(self.directory) as recording, _spinning() as executor:
                key = read_key(self._key_file) if self._key_file else b""
                place = self.directory / DIRECTORY
                with addresses.while_made():
                    monitor = MonitorNode(self.experiment, recording, self._run, self.names, place, key)

                def is_done(name: str, code: int) -> bool:
                    if code == 0 and addresses.has_new():
                        return True  # this process did not hear it, and is about to begin anew
                    if name != PLAYER:
                        return code == 0 and monitor.has_departed(name)
                    return code == 0 and _hear_out(executor, monitor)

                with (
                    waking(executor, monitor, clock),
                    closing(self._farewell(monitor)) as farewell,
                    closing(MessageLoop(monitor, executor)) as loop,
                ):
                    while not (monitor.finished and farewell.is_over()):
                        loop.glance(GLANCE, DEPTH)
                        news = [*supervisor.poll(monitor.statuses, is_done), *recording.news, *farewell.news]
                        news += self._heal(supervisor, monitor)
                        recording.news.clear()
                        farewell.news.clear()
                        monitor.declare_without(supervisor.failed())
                        on_tick(monitor, supervisor, news)
                        if moved := addresses.changed():
                            raise HostMovedError(f"{moved}; go on by `mabirds run --resume {self.directory}`")
                        if self._difference(monitor):
                            _spin_for(SHUTDOWN_TIMEOUT, executor)  # other hosts are to hear of it, too
                            raise ExperimentError(self._difference(monitor))
                    on_tick(monitor, supervisor, farewell.last_words())
                return self._result(monitor)
        finally:
            supervisor.stop()
            signal.signal(signal.SIGTERM, before)
            rclpy.try_shutdown()

    @cached_property
    def _deafness(self) -> Deafness:
        """Of learners that wait for each other; in resilient mode, and of central methods, nobody does."""
        waits = not (self.method or self.experiment.mixing.declares_members)
        own = self.only or (*self.names, PLAYER)
        return Deafness([name for name in (*self.names, PLAYER) if waits and name in own])

    def _heal(self, supervisor: Supervisor, monitor: MonitorNode) -> Iterator[str]:
        """Start again who does not hear the others. Raises DeafSupervisorError where this process is deaf."""
        sent = dict(zip(monitor.player.learners, monitor.player.sent, strict=True)) if monitor.player else {}
        for name, words in self._deafness.found(monitor.statuses, monitor.parameters, sent, monitor.presence.is_lost):
            supervisor.restart(name)
            yield f"{name} is started again, since {words}"
        if deaf := self._deafness.unheard(monitor.statuses, monitor.parameters):
            raise DeafSupervisorError(f"{deaf}; go on by `mabirds run --resume {self.directory}`")

    def _farewell(self, monitor: MonitorNode) -> Farewell:
        return Farewell(self.only, [*self.names, PLAYER], monitor.digest)

    def _result(self, monitor: MonitorNode) -> NetworkResult:
        monitor.kept.fill_from(self.directory / "checkpoints")
        departed = [name for name in self.names if name not in monitor.taking_part()]
        return NetworkResult(monitor.history(), monitor.delivered(), monitor.mass_residual(), departed)

    @property
    def _optional(self) -> Sequence[str]:
        """Who may die for good: learners in resilient mode."""
        return self.names if self.experiment.mixing.declares_members and not self.method else ()

    @cached_property
    def _key_file(self) -> Path | None:
        """Of the key of this run's declarations; None where nobody declares, or other hosts have to know it, too."""
        if not self.experiment.mixing.declares_members or self.method or self.only:
            return None
        make_key(self.directory / KEY)
        return self.directory / KEY

    @cached_property
    def _run(self) -> str:
        """A name that no other run has, or that of all hosts of this one."""
        return self.shared_run if self.shared_run or self.only else f"{self.directory.name}-{secrets.token_hex(4)}"

    def _difference(self, monitor: MonitorNode) -> str | None:
        """How another host's experiment differs from this one; of other runs in this domain it may."""
        for reason in OTHER_EXPERIMENT if self.only else ():
            if words := monitor.refusals.get(reason):
                told = f". {monitor.differences()}" if monitor.differences() else ""
                return f"{words}; start all hosts with the same experiment file and the same --run{told}"
        return None

    def _commands(self) -> dict[str, list[str]]:
        """Command lines by name, in the order in which to start them."""
        commands = {name: self._learning_command(name) for name in self.names}
        player = {**self.player, "run": self._run, "baseline": self.method or "", "bag_digest": self.bag_digest}
        commands[PLAYER] = processes.player_command(self.file, player)
        return {name: commands[name] for name in self.only or self.order or commands}

    def _learning_command(self, name: str) -> list[str]:
        if self.method:
            return processes.baseline_command(name, self.file, run=self._run)
        checkpoints = str(self.directory / "checkpoints" / name)
        key = {"declaration_key": str(self._key_file)} if self._key_file else {}
        return processes.learner_command(name, self.file, run=self._run, checkpoints=checkpoints, **key)


@contextmanager
def _spinning() -> Iterator[SingleThreadedExecutor]:
    """An executor whose nodes are destroyed with it, and so leave the network at once."""
    executor = SingleThreadedExecutor()
    try:
        yield executor
    finally:
        for node in executor.get_nodes():
            node.destroy_node()
        executor.shutdown()


def _spin_for(seconds: float, executor: SingleThreadedExecutor) -> None:
    deadline = time.monotonic() + seconds
    while time.monotonic() < deadline:
        executor.spin_once(timeout_sec=TICK)


def _hear_out(executor: SingleThreadedExecutor, monitor: MonitorNode) -> bool:
    """Has every learner learned everything? Waits a moment for messages that are still on their way."""
    deadline = time.monotonic() + SHUTDOWN_TIMEOUT
    while not monitor.all_learned and time.monotonic() < deadline:
        executor.spin_once(timeout_sec=TICK)
    return monitor.all_learned
