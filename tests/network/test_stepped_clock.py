"""A stepped clock is what processes see, and timers of ours go on where those of ROS stand still."""

import os
import select
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from stepped_clock import SteppedClock, clock_obstacle, compile_c

OBSTACLE = clock_obstacle()
needs_compiler = pytest.mark.skipif(OBSTACLE is not None, reason=f"no stepped clock: {OBSTACLE}")

HOUR = 3600.0

TELL = """
import datetime, time
for _ in range(3):
    input()
    print(time.time(), time.time_ns() / 1e9, datetime.datetime.now().timestamp(), time.monotonic(), flush=True)
"""

TIMERS = """
import rclpy, time
from rclpy.node import Node
from mabirds_msgs_py.network_node import NetworkNode
rclpy.init()
ticks = {"ros": 0, "steady": 0}
def tick(name):
    ticks[name] += 1
nodes = [Node("ros"), NetworkNode("steady")]
executor = rclpy.executors.SingleThreadedExecutor()
for node in nodes:
    node.create_timer(0.05, lambda name=node.get_name(): tick(name))
    executor.add_node(node)
def count():
    ticks.update(ros=0, steady=0)
    end = time.monotonic() + 0.5
    while time.monotonic() < end:
        executor.spin_once(timeout_sec=0.05)
    print(ticks["ros"], ticks["steady"], flush=True)
count()
input()
executor.spin_once(timeout_sec=0.1)
count()
"""

NODE = """
import sys
from mabirds_msgs_py import clock_watch
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.node_main import run_node
clock_watch.PERIOD = float(sys.argv[1])
class Ticking(NetworkNode):
    def __init__(self):
        super().__init__("ticking")
        self.create_timer(0.05, lambda: print(1, flush=True))
sys.exit(run_node(Ticking, "", []))
"""


@pytest.fixture
def clock(tmp_path: Path) -> SteppedClock:
    return SteppedClock(tmp_path, "here")


def start(clock: SteppedClock, program: str) -> "subprocess.Popen[str]":
    command, environment = [sys.executable, "-c", program], {**os.environ, **clock.environment}
    return subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment)


def line(process: "subprocess.Popen[str]") -> list[float]:
    assert process.stdout
    return [float(word) for word in process.stdout.readline().split()]


def go_on(process: "subprocess.Popen[str]") -> None:
    assert process.stdin
    process.stdin.write("\n")
    process.stdin.flush()


@needs_compiler
def test_the_system_clock_steps_and_steady_ones_do_not(clock: SteppedClock) -> None:
    with start(clock, TELL) as process:
        for seconds in (0.0, -HOUR, 1.5 * HOUR):
            clock.set(seconds)
            go_on(process)
            *system, steady = line(process)
            assert all(abs(told - time.time() - seconds) < 5 for told in system)
            assert abs(steady - time.monotonic()) < 5


@needs_compiler
def test_timers_of_ros_stand_still_and_ours_do_not(clock: SteppedClock) -> None:
    with start(clock, TIMERS) as process:
        ros, steady = line(process)
        assert min(ros, steady) >= 5
        clock.set(-HOUR)
        go_on(process)
        ros, steady = line(process)
        assert ros <= 1
        assert steady >= 5


@needs_compiler
def test_a_wait_until_a_time_ends_when_the_clock_is_set_beyond_it(clock: SteppedClock, tmp_path: Path) -> None:
    """As with the machine's own clock; the wait is one of C, since those of Python are steady."""
    source, program = tmp_path / "wait.c", tmp_path / "wait"
    source.write_text(
        "#include <pthread.h>\n#include <time.h>\nint main(void) { pthread_mutex_t m = PTHREAD_MUTEX_INITIALIZER;"
        " pthread_cond_t c = PTHREAD_COND_INITIALIZER; struct timespec t; clock_gettime(CLOCK_REALTIME, &t);"
        " t.tv_sec += 1800; pthread_mutex_lock(&m); return pthread_cond_timedwait(&c, &m, &t) == 110 ? 7 : 1; }",
        encoding="utf-8",
    )
    compile_c("-o", str(program), str(source))
    threading.Timer(0.3, clock.set, [HOUR]).start()
    done = subprocess.run([program], env={**os.environ, **clock.environment}, timeout=20, check=False)
    assert done.returncode == 7


@contextmanager
def a_node(clock: SteppedClock, look: float) -> Iterator["subprocess.Popen[str]"]:
    """A node alone, which looks at the clock so often."""
    command, environment = [sys.executable, "-c", NODE, str(look)], {**os.environ, **clock.environment}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment) as process:
        try:
            yield process
        finally:
            process.kill()


@contextmanager
def announcements() -> Iterator[socket.socket]:
    """Gets what participants on this host say about themselves, every three seconds, to whom it may concern."""
    port = 7400 + 250 * int(os.environ["ROS_DOMAIN_ID"])
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        receiver.bind(("239.255.0.1", port))
        group = socket.inet_aton("239.255.0.1") + socket.inet_aton("127.0.0.1")
        receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
        yield receiver


def count(receiver: socket.socket, seconds: float) -> int:
    """Datagrams from now on."""
    received, end = 0, time.monotonic() + seconds
    while (left := end - time.monotonic()) > 0:
        readable, _, _ = select.select([receiver], [], [], left)
        received += len([receiver.recv(65536) for _ in readable])
    return received


@needs_compiler
@pytest.mark.parametrize(("look", "goes_on"), [(0.1, True), (1000.0, False)])
def test_nobody_waits_for_a_time_that_was_set_back(clock: SteppedClock, look: float, goes_on: bool) -> None:
    """A node alone ticks and announces itself as before; without a look at the clock it would sleep for an hour."""
    clock.set(HOUR)
    with announcements() as receiver, a_node(clock, look) as process:
        line(process)
        assert count(receiver, 4.0)
        clock.set(0.0)
        count(receiver, 1.0)
        assert bool(count(receiver, 8.0)) == goes_on
        assert process.stdout
        ticks = os.read(process.stdout.fileno(), 65536).count(b"\n")
        assert (ticks > 100) == goes_on


def test_ci_can_step_clocks() -> None:
    assert OBSTACLE is None or "CI" not in os.environ, OBSTACLE
