"""The operating-system side of a run: one process per node, each in its own process group with its own log."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from mabirds_msgs_py.security import enclave_arguments
from mabirds_msgs_py.supervised import SUPERVISOR

PLAYER = "expert_player"
"""Name of the player among the processes."""

STOP_PATIENCE = 5.0
"""Seconds between SIGTERM and SIGKILL."""

ONE_THREAD = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
"""N learners share the machine; arithmetic in several threads would also cost the bit-for-bit equality."""


@dataclass(frozen=True)
class NodeProcess:
    """A running node and where its output goes."""

    name: str
    popen: "subprocess.Popen[bytes]"
    log: Path

    @property
    def exit_code(self) -> int | None:
        """None while it runs; negative: ended by that signal."""
        return self.popen.poll()


def learner_command(learner: str, experiment: Path, **parameters: object) -> list[str]:
    """The command line of one learner's process; ``parameters``: of the node, such as run and checkpoints."""
    return _command("mabirds_learner", learner, experiment, parameters)


def baseline_command(method: str, experiment: Path, **parameters: object) -> list[str]:
    """The command line of a central method's process."""
    return _command("mabirds_learner.baseline_node", method, experiment, parameters)


def _command(module: str, name: str, experiment: Path, parameters: Mapping[str, object]) -> list[str]:
    arguments = _parameters({"experiment": str(experiment), **parameters})
    enclave = enclave_arguments(f"/{name}")
    return [sys.executable, "-m", module, "--ros-args", "-r", f"__ns:=/{name}", *enclave, *arguments]


def command_of(module: str, name: str) -> list[str]:
    """The command line of a process of a namespace that has no parameters."""
    return [sys.executable, "-m", module, "--ros-args", "-r", f"__ns:=/{name}"]


def bare_command(name: str, experiment: Path) -> list[str]:
    """The command line of a process that passes what a learner passes, and does nothing else."""
    return _command("mabirds_bringup.bench.exchange.bare", name, experiment, {})


def player_command(experiment: Path, parameters: Mapping[str, object]) -> list[str]:
    """The command line of the expert player's process."""
    arguments = _parameters({"experiment": str(experiment), **parameters})
    enclave = enclave_arguments("/expert_player")
    return [sys.executable, "-m", "mabirds_expert_player", "--ros-args", *enclave, *arguments]


def _parameters(values: Mapping[str, object]) -> list[str]:
    """ROS parameters as arguments; as JSON, which ROS's YAML takes without tripping over spaces and signs."""
    return [part for name, value in values.items() for part in ("-p", f"{name}:={json.dumps(value)}")]


def start(name: str, command: Sequence[str], log_directory: Path) -> NodeProcess:
    """Start a node in a process group of its own; its output is added to ``log_directory/name.log``."""
    log = log_directory / f"{name}.log"
    environment = {
        **os.environ,
        **ONE_THREAD,
        "ROS_LOG_DIR": str(log_directory / "ros"),
        "PYTHONUNBUFFERED": "1",
        SUPERVISOR: str(os.getpid()),
    }
    with log.open("ab") as output:
        popen = subprocess.Popen(
            command,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=subprocess.STDOUT,
            env=environment,
            start_new_session=True,
        )
    return NodeProcess(name, popen, log)


def stop(processes: Sequence[NodeProcess]) -> None:
    """SIGTERM to all, then SIGKILL to the groups of those that are still there after STOP_PATIENCE."""
    for process in processes:
        _signal(process, signal.SIGTERM)
        _signal(process, signal.SIGCONT)  # one that was stopped hears it then
    deadline = time.monotonic() + STOP_PATIENCE
    for process in processes:
        try:
            process.popen.wait(max(0.0, deadline - time.monotonic()))
        except subprocess.TimeoutExpired:
            _signal(process, signal.SIGKILL)
            process.popen.wait()


def _signal(process: NodeProcess, number: int) -> None:
    if process.exit_code is None:
        os.killpg(process.popen.pid, number)


def last_lines(log: Path, count: int = 5) -> str:
    """The end of a log, for an error message."""
    return "\n".join(log.read_text(encoding="utf-8", errors="replace").splitlines()[-count:])
