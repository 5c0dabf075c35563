"""Settings that would end or hang a process are refused in one line."""

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from mabirds_msgs_py.process_settings import LEAST_MEMORY, ProcessSettingsError, check_process_settings

NODE = [sys.executable, "-m", "mabirds_learner"]
MABIRDS = [sys.executable, "-m", "mabirds_bringup"]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"ROS_DOMAIN_ID": "abc"}, "ROS_DOMAIN_ID is 'abc', expected a number from 0 to 232"),
        ({"ROS_DOMAIN_ID": "233"}, "ROS_DOMAIN_ID is '233'"),
        ({"ROS_DOMAIN_ID": "-1"}, "ROS_DOMAIN_ID is '-1'"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF"}, "is 'OFF': nobody would hear this process"),
        ({"ROS_AUTOMATIC_DISCOVERY_RANGE": "localhost"}, "is 'localhost': ROS would keep to this host"),
        ({"HOME": "/proc/nowhere"}, "/proc/nowhere/.ros/log: ROS cannot write its logs here; set HOME, or ROS_LOG_DIR"),
        ({"ROS_LOG_DIR": "/proc"}, "/proc: ROS cannot write"),
    ],
)
def test_a_setting_is_refused(tmp_path: Path, change: dict[str, str], words: str) -> None:
    good = {"HOME": str(tmp_path), "ROS_DOMAIN_ID": "232", "ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}
    check_process_settings([], good)
    check_process_settings([], {"HOME": str(tmp_path)})
    if words.startswith("/proc: ") and os.access("/proc", os.W_OK):
        pytest.skip("this user may write anywhere")
    with pytest.raises(ProcessSettingsError, match=words.split(":", maxsplit=1)[0]) as caught:
        check_process_settings([], {**good, **change})
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--ros-args", "--enclave=/x"], "--enclave=/x: ROS takes --enclave and its value apart"),
        (["--ros-args", "__ns:=/x"], "write --ros-args -r __ns:=/x"),
        (["__node:=x"], "write --ros-args -r __node:=x"),
    ],
)
def test_arguments_that_ros_does_not_take_are_refused(tmp_path: Path, arguments: list[str], words: str) -> None:
    with pytest.raises(ProcessSettingsError) as caught:
        check_process_settings(arguments, {"HOME": str(tmp_path)})
    assert words in str(caught.value)
    check_process_settings(["--ros-args", "-r", "__ns:=/x", "--enclave", "/x"], {"HOME": str(tmp_path)})


def test_too_little_memory_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for limit, refused in ((LEAST_MEMORY * 1024 - 1, True), (LEAST_MEMORY * 1024, False), (-1, False)):
        monkeypatch.setattr(resource, "getrlimit", lambda _, limit=limit: (limit, limit))
        if refused:
            with pytest.raises(ProcessSettingsError, match="ulimit -v"):
                check_process_settings([], {"HOME": str(tmp_path)})
        else:
            check_process_settings([], {"HOME": str(tmp_path)})


def run(command: list[str], **options: object) -> "subprocess.CompletedProcess[str]":
    done: subprocess.CompletedProcess[str] = subprocess.run(
        command, stderr=subprocess.PIPE, text=True, timeout=60, check=False, **options
    )
    return done


def one_line(done: "subprocess.CompletedProcess[str]", words: str) -> bool:
    return done.stderr.startswith("error: ") and done.stderr.count("\n") == 1 and words in done.stderr


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"RMW_IMPLEMENTATION": "rmw_nowhere"}, "installed here: rmw_fastrtps_cpp"),
        ({"ROS_DOMAIN_ID": "x"}, "expected a"),
    ],
)
def test_processes_end_with_one_line(change: dict[str, str], words: str) -> None:
    for command in (NODE, [*MABIRDS, "inspect", "--once"]):
        done = run(command, env={**os.environ, **change}, stdout=subprocess.PIPE)
        assert (done.returncode, one_line(done, words)) == (2, True), done.stderr


def test_a_closed_output_is_one_line(tmp_path: Path) -> None:
    command = ["sh", "-c", 'exec "$@" >&-', "sh", *MABIRDS, "simulate", str(tmp_path)]
    done = run(command)
    assert (done.returncode, one_line(done, "standard output is closed")) == (2, True), done.stderr


@pytest.mark.parametrize("command", [NODE, [*MABIRDS, "kinds"]])
def test_ctrl_c_while_modules_are_loaded_is_one_line(command: list[str]) -> None:
    """From when the process's own code runs; until then it is the interpreter's to say."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    signal.signal(signal.SIGINT, before)
    wait_until_loading(process.pid)
    process.send_signal(signal.SIGINT)
    _, errors = process.communicate(timeout=30)
    assert (process.returncode, errors) == (130, "error: interrupted while loading; nothing was started\n")


def wait_until_loading(pid: int) -> None:
    """Until numpy, the first of what takes time, is mapped into the process."""
    wait(lambda: "numpy" in Path(f"/proc/{pid}/maps").read_text(encoding="utf-8"))


def wait(condition: Callable[[], bool]) -> None:
    deadline = time.monotonic() + 20
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.001)
