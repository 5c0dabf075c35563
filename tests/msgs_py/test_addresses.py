"""Addresses of this host, and that a change is noticed once it lasts."""

import time

import psutil

from mabirds_msgs_py.addresses import LASTING, AddressWatch, own_addresses


def test_they_are_those_that_the_system_names() -> None:
    up = {name for name, state in psutil.net_if_stats().items() if state.isup}
    expected = {
        f"{name} {address.address}"
        for name, addresses in psutil.net_if_addrs().items()
        for address in addresses
        if name in up and address.family.name == "AF_INET"
    }
    assert "lo 127.0.0.1" in own_addresses()
    assert own_addresses() <= expected


class Host:
    def __init__(self) -> None:
        self.addresses, self.now, self.looks = frozenset({"eth0 10.0.0.1"}), 0.0, 0
        self.watch = AddressWatch(self.look, lambda: self.now)

    def look(self) -> frozenset[str]:
        self.looks += 1
        return self.addresses

    def seen(self, seconds: float) -> str | None:
        self.now += seconds
        return self.watch.changed()


def test_a_change_that_lasts_is_told() -> None:
    host = Host()
    assert host.seen(5.0) is None
    host.addresses = frozenset({"eth0 10.0.0.2"})
    assert host.seen(1.0) is None
    assert host.seen(LASTING / 2) is None
    told = host.seen(LASTING)
    assert told == "addresses of this host have changed (gone: eth0 10.0.0.1; new: eth0 10.0.0.2)"


def test_what_comes_back_at_once_is_not() -> None:
    host = Host()
    host.addresses = frozenset()
    assert host.seen(1.0) is None
    host.addresses = frozenset({"eth0 10.0.0.1"})
    assert host.seen(2.0) is None
    assert host.seen(10.0) is None


def test_a_link_that_is_down_is_no_change() -> None:
    """Its address comes back with it; a participant that was made before hears again then."""
    host = Host()
    host.addresses = frozenset()
    assert host.seen(1.0) is None
    assert host.seen(60.0) is None


def test_a_link_that_comes_up_is() -> None:
    host = Host()
    host.addresses |= {"eth1 10.0.1.1"}
    assert host.seen(1.0) is None
    assert host.seen(LASTING) == "addresses of this host have changed (gone: none; new: eth1 10.0.1.1)"


def test_what_was_away_for_a_moment_while_the_participant_was_made_is_new() -> None:
    host, before = Host(), 0
    with host.watch.while_made():
        host.addresses = frozenset()
        before = host.looks
        while host.looks < before + 2:
            time.sleep(0.001)
        host.addresses = frozenset({"eth0 10.0.0.1"})
    assert host.seen(1.0) is None
    assert host.seen(LASTING) == "addresses of this host have changed (gone: none; new: eth0 10.0.0.1)"


def test_it_looks_once_a_second_at_most() -> None:
    host = Host()
    for _ in range(100):
        host.seen(0.1)
    assert host.looks <= 12
