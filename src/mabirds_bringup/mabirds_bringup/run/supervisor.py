"""Keeping the processes of a run alive: a few started at a time, and started again where one dies."""

import signal
import time
from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mabirds_bringup import exit_codes
from mabirds_bringup.exit_codes import BAD_INPUT
from mabirds_bringup.run import processes
from mabirds_bringup.run.processes import NodeProcess
from mabirds_core.errors import MabirdsError
from mabirds_msgs_py.node_main import EXIT_MOVED

AT_ONCE = 8
"""Processes that may be starting at the same time: many at once take all processors and find each other late."""

START_PATIENCE = 5.0
"""Seconds after which a process counts as started even if nothing was heard of it."""

FIRST_PAUSE, MAX_PAUSE = 0.5, 30.0
"""Seconds before the first restart, doubled at each further one."""

HEALTHY = 10.0
"""A process that lived for so many seconds has its restarts back."""


class ProcessDiedError(MabirdsError):
    """A node ended before its time."""

    exit_code = exit_codes.PROCESS_DIED


@dataclass
class ManagedProcess:
    """One node of the run: its process once there is one, and how often it was started again."""

    name: str
    command: Sequence[str]
    process: NodeProcess | None = None
    started: float = 0.0
    restarts: int = 0
    due: float | None = 0.0
    """When to start it; None while it runs, and once it is done."""
    failed: bool = False


class Supervisor:
    """The children of a run by name, in the order in which to start them.

    ``restarts``: how often a child may be started again. One that refused its input is never started again, since it
    would refuse it again. ``optional``: names without which the run goes on; all others end it.
    """

    def __init__(
        self,
        commands: Mapping[str, Sequence[str]],
        log_directory: Path,
        restarts: int,
        optional: Collection[str] = (),
    ) -> None:
        self.children = {name: ManagedProcess(name, command) for name, command in commands.items()}
        self._log_directory, self._restarts, self._optional = log_directory, restarts, optional

    def poll(self, heard: Collection[str], is_done: Callable[[str, int], bool]) -> list[str]:
        """Start what is due and restart what died; returns words for people about what died.

        ``heard``: names of children that are known to be up. ``is_done``: may this child have ended with this exit
        code? Raises ProcessDiedError where a child ended and may not be started again.
        """
        now = time.monotonic()
        news = [self._on_end(child, now) for child in self.children.values() if self._has_died(child, is_done)]
        starting = [child for child in self.children.values() if child.name not in heard and self._is_young(child, now)]
        due = [child for child in self.children.values() if child.due is not None and child.due <= now]
        for child in due[: max(0, AT_ONCE - len(starting))]:
            child.process = processes.start(child.name, child.command, self._log_directory)
            child.started, child.due = now, None
        return news

    def _is_young(self, child: ManagedProcess, now: float) -> bool:
        return child.due is None and now - child.started < START_PATIENCE

    def _has_died(self, child: ManagedProcess, is_done: Callable[[str, int], bool]) -> bool:
        unwatched = child.process is None or child.due is not None or child.failed
        code = None if unwatched or child.process is None else child.process.exit_code
        return code is not None and not is_done(child.name, code)

    def _on_end(self, child: ManagedProcess, now: float) -> str:
        """Plan the restart of a child that died."""
        assert child.process is not None  # noqa: S101 - for the type checker
        if child.process.exit_code == EXIT_MOVED:
            child.due = now
            return f"{child.name} is started again, since addresses of this host have changed"
        if now - child.started > HEALTHY:
            child.restarts = 0
        what = f"{child.name} ended {_how(child.process.exit_code)}"
        if child.restarts >= self._restarts or child.process.exit_code == BAD_INPUT:
            if child.name in self._optional:
                child.failed = True
                return f"{what}; going on without it"
            log = child.process.log
            raise ProcessDiedError(f"{what}; the end of {log}:\n{processes.last_lines(log)}")
        pause = min(FIRST_PAUSE * 2**child.restarts, MAX_PAUSE)
        child.restarts, child.due = child.restarts + 1, now + pause
        return f"{what}; starting it again in {pause:g} s ({child.restarts} of {self._restarts})"

    def restart(self, name: str) -> None:
        """End a child and start it again, which is no fault of it and does not count."""
        child = self.children[name]
        if child.process is not None and child.due is None:
            processes.stop([child.process])
            child.due = time.monotonic()

    def failed(self) -> list[str]:
        """Children that ended for good while the run goes on."""
        return [child.name for child in self.children.values() if child.failed]

    def stop(self) -> None:
        """End all children, also stopped ones."""
        processes.stop([child.process for child in self.children.values() if child.process is not None])


def _how(exit_code: int | None) -> str:
    if exit_code is not None and exit_code < 0:
        return f"with exit code {exit_code} ({signal.Signals(-exit_code).name})"
    return f"with exit code {exit_code}"
