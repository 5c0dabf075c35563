"""Links that are down at first and addresses that change: every bit of the result stays, nothing has to be done."""

from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from halves import Halves, settings, two_halves
from namespaces import obstacle

from mabirds_msgs_py.environment import FASTDDS_PROFILE

OBSTACLE = obstacle()
pytestmark = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")


@pytest.fixture
def halves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Halves]:
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(FASTDDS_PROFILE))  # other tests keep to this host
    with two_halves(tmp_path) as made:
        yield made


def test_a_host_whose_link_comes_up_after_its_start_joins(make_experiment: Callable[..., Path], halves: Halves) -> None:
    file = make_experiment(**settings())
    halves.lan.cut("right")
    for host in halves.parts:
        halves.start_part(host, file)
    halves.wait(lambda: halves.newest("left") and halves.newest("right"))
    halves.lan.plug("right")
    halves.assert_all_whole(file)
    assert "new: eth0 10.77.0.2" in halves.said("right")
    assert "have changed" not in halves.said("left")


def test_addresses_change_in_mid_run(make_experiment: Callable[..., Path], halves: Halves) -> None:
    """Of the host with the player, and then of the other; none of it counts as a death."""
    file = make_experiment(**settings(iterations=50))
    for host in halves.parts:
        halves.start_part(host, file, "--restarts", "0")
    change_address(halves, "right")
    assert "have changed" not in halves.said("left")
    change_address(halves, "left")
    halves.assert_all_whole(file)


def change_address(halves: Halves, host: str) -> None:
    """Once a host gets on, and wait until it has begun anew."""
    reached = halves.newest(host)
    halves.wait(lambda: halves.newest(host) > reached + 5)
    halves.lan.readdress(host)
    halves.wait(lambda: f"new: eth0 {halves.lan.hosts[host].address}" in halves.said(host))
