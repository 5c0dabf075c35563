"""Who looks lets others go first, also across sessions."""

import subprocess
import sys
from pathlib import Path

import pytest

PROGRAM = """
import os
from pathlib import Path
from mabirds_bringup.priority import set_niceness, step_back
group = Path("/proc/self/autogroup")
def told():
    return f"{os.getpriority(os.PRIO_PROCESS, 0)} {group.read_text().split()[-1] if group.exists() else 'none'}"
step_back(7)
print(told())
set_niceness(9)
print(told())
"""
AUTOGROUPS = Path("/proc/self/autogroup").exists()
"""Does the system have niceness of sessions?"""


def of_a_session(*command: str) -> list[str]:
    done = subprocess.run(command, start_new_session=True, capture_output=True, text=True, timeout=60, check=True)
    return done.stdout.splitlines()


def test_a_process_with_a_session_of_its_own_lets_other_sessions_go_first() -> None:
    assert of_a_session(sys.executable, "-c", PROGRAM) == (["7 7", "9 9"] if AUTOGROUPS else ["7 none", "9 none"])


@pytest.mark.parametrize(
    ("beside", "session"), [("", "7"), ("sleep 60 & trap 'kill %1' EXIT; ", "0")], ids=["alone", "with others"]
)
def test_a_shell_waits_and_its_other_processes_are_not_slowed(beside: str, session: str) -> None:
    code = f'{beside}"{sys.executable}" -c "$0"; true'
    first, _ = of_a_session("bash", "-c", code, PROGRAM)
    assert first == f"7 {session if AUTOGROUPS else 'none'}"


def test_a_session_that_goes_on_is_as_before() -> None:
    told = of_a_session("bash", "-c", f'"{sys.executable}" -c "$0"; cat /proc/self/autogroup || true', PROGRAM)
    assert told[2:] == ([told[2]] if AUTOGROUPS else [])
    assert not AUTOGROUPS or told[2].endswith("nice 0")
