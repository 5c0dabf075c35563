"""Ending with the process that started this one, whatever ends that."""

import ctypes
import os
import signal
import sys

SUPERVISOR = "MABIRDS_SUPERVISOR"
"""Environment variable: the process id of a parent without which this process should not live on."""

PR_SET_PDEATHSIG = 1


def end_with_supervisor() -> None:
    """Ask the kernel for SIGKILL should the supervisor be killed: no process is left behind, not even a stopped one.

    What a learner has said is in its checkpoints by then, and what was judged in its file.
    """
    supervisor = os.environ.get(SUPERVISOR)
    if supervisor is None or sys.platform != "linux":
        return
    ctypes.CDLL(None).prctl(PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != int(supervisor):
        sys.exit("error: the supervisor is gone")
