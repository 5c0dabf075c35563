"""The virtual network itself, by datagrams of our own: what passes, what is dropped and counted, what is left over."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from namespaces import Counts, NamespaceError, VirtualLan, obstacle, virtual_lan

OBSTACLE = obstacle()
needs_namespaces = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")

PYTHON = [sys.executable, "-I", "-S"]
"""Without this environment's packages it starts in no time."""

GROUP = "239.1.2.3"
RECEIVE = f"""
import socket, sys
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
    receiver.bind(("", 9999))
    member = socket.inet_aton("{GROUP}") + socket.inet_aton(sys.argv[1])
    receiver.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, member)
    print("ready", flush=True)
    input()  # everything is sent, though some of it may still be on its way
    receiver.settimeout(0.3)
    count = 0
    try:
        while receiver.recv(65535):
            count += 1
    except TimeoutError:
        print(count)
"""
SEND = """
import socket, sys
with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sender:
    for _ in range(int(sys.argv[2])):
        sender.sendto(bytes(int(sys.argv[3])), (sys.argv[1], 9999))
"""


@pytest.fixture
def lan() -> Iterator[VirtualLan]:
    with virtual_lan(["a", "b", "c", "d"]) as made:
        yield made


def received(lan: VirtualLan, sender: str, receiver: str, group: str = "", size: int = 100, count: int = 10) -> int:
    """How many of ``count`` datagrams of ``size`` bytes arrive."""
    address = lan.hosts[receiver].address
    command = lan.inside(receiver, [*PYTHON, "-c", RECEIVE, address])
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout
        assert process.stdout.readline() == "ready\n"
        send(lan, sender, group or address, size, count)
        output, _ = process.communicate("sent\n")
        return int(output)


def send(lan: VirtualLan, sender: str, address: str, size: int, count: int) -> None:
    subprocess.run(lan.inside(sender, [*PYTHON, "-c", SEND, address, str(count), str(size)]), check=True)


def namespaces(owner: int) -> set[str]:
    """Those that the process ``owner`` made."""
    names = [line.split()[0] for line in output_of("ip", "netns", "list").splitlines()]
    return {name for name in names if name.startswith(f"mabirds-{owner}-")}


def own_network() -> list[str]:
    """This machine's own links, addresses, routes and packet filter."""
    return [output_of(*command.split()) for command in ("ip link", "ip route show table all", "nft list ruleset")]


def output_of(*command: str) -> str:
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


@needs_namespaces
def test_hosts_hear_each_other(lan: VirtualLan) -> None:
    assert received(lan, "a", "b") == 10
    assert received(lan, "b", "a", group=GROUP) == 10
    assert received(lan, "c", "c") == 10


@needs_namespaces
def test_a_cut_host_hears_and_says_nothing(lan: VirtualLan) -> None:
    lan.cut("b")
    before = lan.traffic("b")
    assert received(lan, "a", "b") == received(lan, "a", "b", group=GROUP) == 0
    assert lan.traffic("b") == before
    assert received(lan, "a", "c") == 10
    lan.heal()
    assert received(lan, "b", "a") == 10
    assert lan.traffic("b").sent >= before.sent + 10


@needs_namespaces
def test_a_partition_passes_only_what_stays_on_one_side(lan: VirtualLan) -> None:
    assert received(lan, "a", "c") == received(lan, "d", "b") == 10  # now they know each other's hardware addresses
    lan.partition(["a", "b"])
    assert received(lan, "a", "b") == received(lan, "c", "d") == 10
    assert lan.counts().cut == 0
    assert received(lan, "a", "c") == received(lan, "d", "b") == received(lan, "a", "d", group=GROUP) == 0
    assert lan.counts().cut == 40  # the group's 10 went out by the ports of two hosts
    lan.partition(["a", "c"])
    assert received(lan, "a", "c") == 10
    lan.heal()
    assert received(lan, "d", "b") == 10


@needs_namespaces
def test_lost_frames_are_counted_and_independent(lan: VirtualLan) -> None:
    lan.lose(0.3)
    for sender, receiver in (("a", "b"), ("b", "a")):
        before = lan.counts()
        send(lan, sender, lan.hosts[receiver].address, size=10, count=1000)
        lost, passed = lan.counts().lost - before.lost, lan.counts().passed - before.passed
        assert lost + passed == 1000
        assert 230 < lost < 370  # five standard deviations
    lan.heal()
    before = lan.counts()
    assert received(lan, "a", "b", count=50) == 50
    assert lan.counts().lost == before.lost


@needs_namespaces
def test_a_datagram_larger_than_the_mtu_is_as_many_frames_as_it_takes(lan: VirtualLan) -> None:
    assert received(lan, "a", "b", size=1472, count=1) == 1  # 1500 less the headers of IP and UDP
    assert lan.counts() == Counts(passed=1, cut=0, lost=0, multicast=0, fragments=0)
    assert received(lan, "a", "b", size=4000, count=2) == 2
    assert lan.counts() == Counts(passed=1 + 6, cut=0, lost=0, multicast=0, fragments=6)
    lan.set_mtu(9000)
    assert received(lan, "a", "b", size=4000, count=2) == 2
    assert lan.counts() == Counts(passed=1 + 6 + 2, cut=0, lost=0, multicast=0, fragments=6)


@needs_namespaces
def test_dropped_multicast_leaves_the_rest_alone(lan: VirtualLan) -> None:
    lan.drop_multicast()
    assert received(lan, "a", "b", group=GROUP) == 0
    assert lan.counts().multicast >= 10
    assert received(lan, "a", "b") == 10
    lan.heal()
    assert received(lan, "a", "b", group=GROUP) == 10


@needs_namespaces
def test_this_machines_own_network_is_not_touched() -> None:
    before = own_network()
    with virtual_lan(["a", "b"]) as lan:
        lan.lose(0.5)
        lan.partition(["a"])
        assert own_network() == before
    assert own_network() == before


@needs_namespaces
def test_networks_side_by_side_do_not_hear_each_other() -> None:
    with virtual_lan(["a", "b"]) as one, virtual_lan(["a", "b"]) as other:
        assert one.hosts["a"].address == other.hosts["a"].address
        assert received(one, "a", "b") == 10
        assert other.counts().passed == 0


@needs_namespaces
def test_nothing_is_left_behind_after_a_failure() -> None:
    def fail() -> None:
        with virtual_lan(["a", "b"]) as lan:
            processes.append(subprocess.Popen(lan.inside("a", [*PYTHON, "-c", "import time; time.sleep(600)"])))
            raise RuntimeError

    processes: list[subprocess.Popen[bytes]] = []
    with pytest.raises(RuntimeError):
        fail()
    assert namespaces(os.getpid()) == set()
    assert processes[0].wait(timeout=5) == -signal.SIGKILL
    with pytest.raises(NamespaceError, match="File exists"), virtual_lan(["a", "a"]):
        pass
    assert namespaces(os.getpid()) == set()


@needs_namespaces
def test_what_a_killed_process_left_behind_is_removed_by_the_next() -> None:
    program = """
import signal
from namespaces import virtual_lan
with virtual_lan(["a"]):
    print("made", flush=True)
    signal.pause()
"""
    own = Path(__file__).parent  # where a program finds the module
    with subprocess.Popen([sys.executable, "-c", program], stdout=subprocess.PIPE, text=True, cwd=own) as process:
        assert process.stdout
        assert process.stdout.readline() == "made\n"
        with virtual_lan(["a"]):
            assert len(namespaces(process.pid)) == 2
        process.kill()
    assert len(namespaces(process.pid)) == 2
    with virtual_lan(["a"]):
        pass
    assert namespaces(process.pid) == set()


@needs_namespaces
def test_what_cannot_be_is_refused_by_name(lan: VirtualLan) -> None:
    for call in (lan.cut, lan.traffic, lambda host: lan.partition(["a", host]), lambda host: lan.inside(host, [])):
        with pytest.raises(NamespaceError, match="host 'e': expected one of a, b, c, d"):
            call("e")
    for share in (-0.1, 1.1, float("nan")):
        with pytest.raises(NamespaceError, match="expected a number from 0 to 1"):
            lan.lose(share)
    for size in (500, 70_000):
        with pytest.raises(NamespaceError, match=f"MTU {size}: expected 576 to 65535 bytes"):
            lan.set_mtu(size)


def test_without_the_tools_or_the_right_the_obstacle_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    assert obstacle() == (
        "ip: not found; network namespaces take root, ip and nft"
        " (on Debian and Ubuntu: apt-get install iproute2 nftables)"
    )
    refusing = tmp_path / "ip"
    refusing.write_text("#!/bin/sh\necho mkdir /run/netns failed: Permission denied >&2\nexit 255\n", encoding="utf-8")
    refusing.chmod(0o755)
    assert str(obstacle()).startswith("ip netns list: mkdir /run/netns failed: Permission denied; network namespaces")


def test_ci_runs_what_needs_namespaces() -> None:
    assert OBSTACLE is None or "CI" not in os.environ, OBSTACLE
