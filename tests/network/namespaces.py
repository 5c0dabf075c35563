"""Hosts of their own on one machine: network namespaces on a virtual Ethernet whose links can fail.

Each host is a network namespace with one interface, an address, loopback and a route for multicast. Its cable, a veth
pair, ends in a switch: a bridge in one more namespace, so that this machine's own network is not touched. Faults are
made at the switch, which counts what it passes on and what it drops.

    with virtual_lan(["learner_1", "learner_2"]) as lan:
        subprocess.run(lan.inside("learner_1", ["ip", "address"]))
        lan.cut("learner_2")
        lan.heal()

It takes root, and the programs ``ip`` and ``nft`` (Debian's packages iproute2 and nftables).
"""

import json
import os
import re
import secrets
import signal
import subprocess
from collections.abc import Collection, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace
from ipaddress import IPv4Address, IPv4Network
from pathlib import Path
from typing import Any, NamedTuple

from mabirds_core.errors import MabirdsError

PREFIX = "mabirds"
NETWORK = IPv4Network("10.77.0.0/16")
MIN_MTU, MAX_MTU = 576, 65535

RULES = """
table bridge switch {
  counter passed { }
  counter cut { }
  counter lost { }
  counter multicast { }
  counter fragments { }
  chain cut {
    ip protocol udp counter name cut
    drop
  }
  chain partition { }
  chain loss { }
  chain no_multicast { }
  chain forward {
    type filter hook forward priority 0
    jump partition
    ether type != ip accept
    ip protocol != udp accept
    ip frag-off & 0x3fff != 0 counter name fragments
    jump no_multicast
    jump loss
    counter name passed
  }
}
"""
"""What happens to each frame on its way from one host to another; partition, loss and no_multicast are the faults."""


class NamespaceError(MabirdsError):
    """Network namespaces cannot be made or used as asked; names the command, what it said, and the remedy."""


@dataclass(frozen=True)
class Host:
    """One host: its namespace, its address, and the port of the switch that its cable ends in."""

    namespace: str
    address: str
    port: str


class Counts(NamedTuple):
    """Frames of UDP from one host to another since the network was made; a multicast frame counts once a receiver.

    ``cut``: stopped between the parts of a partition; ``lost``: by chance; ``multicast``: where multicast is dropped;
    ``fragments``: those with only a part of a datagram in them, whatever became of them.
    """

    passed: int
    cut: int
    lost: int
    multicast: int
    fragments: int


class Traffic(NamedTuple):
    """Frames that one host's cable carried, of any kind."""

    sent: int
    received: int


@dataclass(frozen=True)
class VirtualLan:
    """Hosts by name and the switch between them. Its methods raise NamespaceError for a name that is no host's."""

    hosts: dict[str, Host]
    switch: str
    free: Iterator[IPv4Address]
    """Addresses that no host has had."""

    def inside(self, host: str, command: Sequence[str]) -> list[str]:
        """The command that runs ``command`` on a host; the process keeps its id, so signals reach it."""
        return ["ip", "netns", "exec", self._host(host).namespace, *command]

    def cut(self, host: str) -> None:
        """Pull a host's cable: nothing gets in or out, and its interface loses the carrier."""
        _ip(self.switch, f"link set dev {self._host(host).port} down")

    def plug(self, host: str) -> None:
        """Plug a host's cable in again."""
        _ip(self.switch, f"link set dev {self._host(host).port} up")

    def readdress(self, host: str) -> None:
        """Give a host an address that nobody had, in the place of the one that it has."""
        before = self._host(host)
        self.hosts[host] = replace(before, address=str(next(self.free)))
        _ip(
            before.namespace,
            f"address delete {before.address}/{NETWORK.prefixlen} dev eth0",
            f"address add {self.hosts[host].address}/{NETWORK.prefixlen} dev eth0",
            "route replace 224.0.0.0/4 dev eth0",
        )

    def partition(self, part: Collection[str]) -> None:
        """Let nothing pass between these hosts and all others; nobody's interface notices."""
        ports = f"{{ {', '.join(self._host(name).port for name in part)} }}"
        self._fault(
            "partition",
            f"iifname {ports} oifname != {ports} goto cut",
            f"iifname != {ports} oifname {ports} goto cut",
        )

    def rejoin(self) -> None:
        """End a partition."""
        self._fault("partition")

    def lose(self, share: float) -> None:
        """Drop this share of all frames of UDP, in both directions, independently of one another.

        A frame is a whole datagram, unless the datagram is larger than the MTU: then it is lost with its first
        lost fragment.
        """
        if not 0 <= share <= 1:
            raise NamespaceError(f"share {share}: expected a number from 0 to 1, such as 0.1 for 10 %")
        self._fault("loss", f"numgen random mod 10000 < {round(share * 10000)} counter name lost drop")

    def drop_multicast(self) -> None:
        """Drop everything that is sent to a multicast group, as many networks do between their segments."""
        self._fault("no_multicast", "ip daddr 224.0.0.0/4 counter name multicast drop")

    def heal(self) -> None:
        """Undo all faults."""
        for chain in ("partition", "loss", "no_multicast"):
            self._fault(chain)
        _ip(self.switch, *(f"link set dev {host.port} up" for host in self.hosts.values()))

    def set_mtu(self, size: int) -> None:
        """Let frames carry up to ``size`` bytes of IP; 1500, as on Ethernet, unless set."""
        if not MIN_MTU <= size <= MAX_MTU:
            raise NamespaceError(f"MTU {size}: expected {MIN_MTU} to {MAX_MTU} bytes, such as 1500")
        for host in self.hosts.values():
            _ip(host.namespace, f"link set dev eth0 mtu {size}")
            _ip(self.switch, f"link set dev {host.port} mtu {size}")

    def counts(self) -> Counts:
        """What the switch has passed on and dropped so far."""
        listing = json.loads(_run([*_inside(self.switch), "nft", "--json", "list", "counters"]))["nftables"]
        packets = {entry["counter"]["name"]: entry["counter"]["packets"] for entry in listing if "counter" in entry}
        return Counts(**packets)

    def traffic(self, host: str) -> Traffic:
        """What a host's cable has carried so far."""
        command = ["ip", "-netns", self.switch, "-json", "-stats", "link", "show", "dev", self._host(host).port]
        statistics: Any = json.loads(_run(command))[0]["stats64"]
        return Traffic(sent=statistics["rx"]["packets"], received=statistics["tx"]["packets"])

    def _host(self, name: str) -> Host:
        if name not in self.hosts:
            raise NamespaceError(f"host {name!r}: expected one of {', '.join(self.hosts)}")
        return self.hosts[name]

    def _fault(self, chain: str, *rules: str) -> None:
        """Replace the rules of a chain, in one step."""
        lines = [f"flush chain bridge switch {chain}", *(f"add rule bridge switch {chain} {rule}" for rule in rules)]
        _nft(self.switch, "\n".join(lines))


@contextmanager
def virtual_lan(names: Sequence[str]) -> Iterator[VirtualLan]:
    """Hosts of these names; in the end they are removed, and processes still on them are killed.

    Namespaces bear this process's id and a random number, so that runs side by side do not collide; what a killed
    process left behind is removed by the next call. Raises NamespaceError where the kernel refuses.
    """
    _remove_leftovers()
    stem = f"{PREFIX}-{os.getpid()}-{secrets.token_hex(3)}"
    with ExitStack() as made:
        switch = made.enter_context(_namespace(f"{stem}-switch"))
        _ip(switch, "link add name bridge type bridge mcast_snooping 0", "link set dev bridge up")
        _nft(switch, RULES)
        hosts, free = {}, NETWORK.hosts()
        for number, (name, address) in enumerate(zip(names, free, strict=False), start=1):
            namespace = made.enter_context(_namespace(f"{stem}-host-{name}"))
            hosts[name] = Host(namespace, str(address), f"port{number}")
            _connect(switch, hosts[name])
        yield VirtualLan(hosts, switch, free)


def obstacle() -> str | None:
    """Why there can be no virtual network here, found by making one; None where there can."""
    try:
        with virtual_lan(["probe"]):
            return None
    except NamespaceError as error:
        return str(error)


@contextmanager
def _namespace(name: str) -> Iterator[str]:
    _run(["ip", "netns", "add", name])
    try:
        _ip(name, "link set dev lo up")
        yield name
    finally:
        _remove(name)


def _connect(switch: str, host: Host) -> None:
    """Lay a host's cable. The route makes multicast, for which there is no address to match, leave by it."""
    _ip(
        switch,
        f"link add name {host.port} type veth peer name eth0 netns {host.namespace}",
        f"link set dev {host.port} master bridge up",
    )
    _ip(
        host.namespace,
        f"address add {host.address}/{NETWORK.prefixlen} dev eth0",
        "link set dev eth0 up",
        "route add 224.0.0.0/4 dev eth0",
    )


def _remove(namespace: str) -> None:
    """Remove a namespace, after killing what still runs in it: it would live on, and keep the namespace alive."""
    for pid in _run(["ip", "netns", "pids", namespace]).split():
        with suppress(ProcessLookupError):
            os.kill(int(pid), signal.SIGKILL)
    _run(["ip", "netns", "delete", namespace])


def _remove_leftovers() -> None:
    """Remove namespaces of processes that no longer live, which had no time to do so themselves."""
    for line in _run(["ip", "netns", "list"]).splitlines():
        name = line.split()[0]
        owner = re.match(rf"{PREFIX}-(\d+)-", name)
        if owner and not Path(f"/proc/{owner[1]}").exists():
            with suppress(NamespaceError):  # another process may be doing the same
                _remove(name)


def _inside(namespace: str) -> list[str]:
    return ["ip", "netns", "exec", namespace]


def _ip(namespace: str, *commands: str) -> None:
    _run(["ip", "-netns", namespace, "-batch", "-"], "\n".join(commands))


def _nft(namespace: str, rules: str) -> None:
    _run([*_inside(namespace), "nft", "--file", "-"], rules)


def _run(command: Sequence[str], text: str = "") -> str:
    """The output of a command that is given ``text``."""
    try:
        done = subprocess.run(command, input=text, capture_output=True, text=True, check=False)
    except FileNotFoundError as error:
        raise NamespaceError(f"{command[0]}: not found; {REMEDY}") from error
    if done.returncode != 0:
        raise NamespaceError(f"{' '.join(command)}: {done.stderr.strip()}; {REMEDY}")
    return done.stdout


REMEDY = "network namespaces take root, ip and nft (on Debian and Ubuntu: apt-get install iproute2 nftables)"
