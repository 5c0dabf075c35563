"""The supervisor's side of the judging process (``evaluate/beside.py``)."""

import json
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any, Self

from mabirds_bringup.run.processes import ONE_THREAD
from mabirds_msgs_py.supervised import SUPERVISOR

PATIENCE = 5.0
"""Seconds between SIGTERM and SIGKILL."""


class Judging:
    """A process that judges a run while it is learned, and ends with this context manager.

    Parameters
    ----------
    directory : Path
        Of the run.
    """

    def __init__(self, directory: Path) -> None:
        self._popen = subprocess.Popen(
            [sys.executable, "-m", "mabirds_bringup.evaluate.beside", str(directory)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            env={**os.environ, **ONE_THREAD, SUPERVISOR: str(os.getpid())},
            start_new_session=True,  # Ctrl-C is for the supervisor, which ends it
        )

    @property
    def process_id(self) -> int:
        """Of the process."""
        return self._popen.pid

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """End it, wherever it is."""
        self._popen.terminate()
        try:
            self._popen.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self._popen.kill()
            self._popen.wait()
        for stream in (self._popen.stdin, self._popen.stdout):
            if stream:
                with suppress(BrokenPipeError):
                    stream.close()

    def results(self, seconds: float, departed: Sequence[str], mass_residual: float | None) -> dict[str, Any] | None:
        """Let it write what came of the run.

        Parameters
        ----------
        seconds : float
            That the run took.
        departed : Sequence[str]
            Learners without which it went on.
        mass_residual : float or None
            Of resilient mode.

        Returns
        -------
        dict or None
            What summary.json holds; None where the process has ended without it.
        """
        request = json.dumps({"seconds": seconds, "departed": list(departed), "mass_residual": mass_residual})
        self._popen.send_signal(signal.SIGCONT)  # one that was stopped would not answer
        with suppress(BrokenPipeError):
            answer, _ = self._popen.communicate(f"{request}\n".encode())
            if self._popen.returncode == 0:
                content: dict[str, Any] = json.loads(answer)
                return content
        return None
