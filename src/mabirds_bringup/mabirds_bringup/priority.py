"""Who goes first on a busy machine: those that learn, before those that look or judge.

Linux shares processors out evenly among sessions (autogroups, sched(7)), and niceness counts only within each. Learners
are sessions of their own, so that a process which only raises its niceness takes as much from them as before. Hence the
niceness of the session is raised, too, where that makes nobody else wait.
"""

import atexit
import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

PROCESSES = Path("/proc")

SESSION_NICENESS = PROCESSES / "self" / "autogroup"


def step_back(niceness: int) -> None:
    """Let others go first until this process ends.

    Parameters
    ----------
    niceness : int
        1 to 19.
    """
    set_niceness(niceness)
    atexit.register(set_niceness, 0)  # a shell's session goes on


def set_niceness(niceness: int, thread: int = 0) -> None:
    """Of a thread, and of the session where all others in it wait for this process; as far as the system lets.

    Parameters
    ----------
    niceness : int
        0 as usual, 19 after all others.
    thread : int
        Of this process, by the system's number; 0: the one that calls.
    """
    with suppress(OSError):  # not everybody may go back to 0
        os.setpriority(os.PRIO_PROCESS, thread, niceness)
    if SESSION_NICENESS.exists() and _others_of_session() <= set(_ancestors()):
        with suppress(OSError):
            SESSION_NICENESS.write_text(str(niceness), encoding="ascii")


def _others_of_session() -> set[int]:
    own = os.getsid(0)
    numbers = {int(entry.name) for entry in PROCESSES.glob("[0-9]*")} - {os.getpid()}
    return {number for number in numbers if _session(number) == own}


def _session(process: int) -> int:
    try:
        return os.getsid(process)
    except OSError:  # it has ended meanwhile
        return 0


def _ancestors() -> Iterator[int]:
    """Parent, its parent, and so on."""
    process = os.getppid()
    while process > 0:
        yield process
        process = _parent(process)


def _parent(process: int) -> int:
    with suppress(OSError):
        text = (PROCESSES / str(process) / "stat").read_text(encoding="utf-8", errors="replace")
        return int(text.rpartition(")")[2].split()[1])  # after name and state, of proc(5)
    return 0
