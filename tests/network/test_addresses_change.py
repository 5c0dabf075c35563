"""Links that are down at first and addresses that change: every bit of the result stays, nothing has to be done."""

import os
import re
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from halves import Halves, settings, two_halves
from namespaces import obstacle

from mabirds_msgs_py.environment import FASTDDS_PROFILE
from mabirds_msgs_py.node_main import EXIT_MOVED
from mabirds_msgs_py.supervised import SUPERVISOR

OBSTACLE = obstacle()
pytestmark = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")


@pytest.fixture
def halves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Halves]:
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(FASTDDS_PROFILE))  # other tests keep to this host
    with two_halves(tmp_path) as made:
        yield made


def test_a_link_that_is_down_at_first_and_an_address_that_changes(
    make_experiment: Callable[..., Path], halves: Halves
) -> None:
    """Of the host with the player, in one run; the other one goes on as it is, and nothing counts as a death."""
    file = make_experiment(**settings(iterations=600))  # thirty seconds: not all is learned when the address changes
    halves.lan.cut("right")
    for host in halves.parts:
        halves.start_part(host, file, "--restarts", "0")
    halves.wait(lambda: halves.newest("left") and halves.newest("right"))
    halves.lan.plug("right")
    halves.wait(lambda: re.search("new: eth0 10.77.0.2.*going on with", halves.said("right"), re.DOTALL))
    begun = halves.newest("right")  # all of its processes are stopped; the next ones have looked for addresses
    halves.wait(lambda: halves.newest("right") > begun + 5)
    halves.lan.readdress("right")
    halves.wait(lambda: "gone: eth0 10.77.0.2; new: eth0 10.77.0.3" in halves.said("right"))
    halves.assert_all_whole(file)
    assert "have changed" not in halves.said("left")


PARTICIPANT = """
import sys
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.node_main import run_node
def create():
    print("begun", flush=True)
    input()
    node = NetworkNode("late")
    print("made", flush=True)
    return node
sys.exit(run_node(create, "", []))
"""


def test_a_link_that_is_down_while_a_participant_is_made(halves: Halves) -> None:
    """Nobody on other hosts would ever hear it; its addresses before and after are the same."""
    command = halves.lan.inside("right", [sys.executable, "-c", PARTICIPANT])
    environment = {**os.environ, SUPERVISOR: str(os.getpid())}
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment
    ) as process:
        assert process.stdin
        assert process.stdout
        assert process.stdout.readline() == "begun\n"
        halves.lan.cut("right")
        process.stdin.write("\n")
        process.stdin.flush()
        assert process.stdout.readline() == "made\n"
        halves.lan.plug("right")
        assert process.wait(timeout=20) == EXIT_MOVED, process.stderr
