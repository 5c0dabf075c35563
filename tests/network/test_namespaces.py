"""Every process on a host of its own, with links that fail: the run is complete and equals the reference bit for bit.

Each test prints what was cut and what was delivered.
"""

import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from namespaces import VirtualLan, obstacle, virtual_lan

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.evaluate.results import audit
from mabirds_bringup.run import processes
from mabirds_bringup.run.processes import NodeProcess, learner_command, player_command
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.environment import FASTDDS_PROFILE

OBSTACLE = obstacle()
pytestmark = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")

LEARNERS = ["learner_1", "learner_2", "learner_3", "learner_4"]
PLAYER, WATCHER, SERVER = "expert_player", "watcher", "server"
RING = {"kind": "static", "graph": "ring"}
LARGE_GAME = {
    "kind": "patrol",
    "map": "\n".join(["." * 24] * 24),
    "starts": [[[0, 0]]],
    "goals": [[0, 5]],
    "horizon": 7,
}
"""Its theta and omega take 23 kB, or 16 frames of 1500 bytes."""

CUT = 25.0
"""Seconds; after 20 without a sign of life Fast DDS gives up a participant."""

STILL = 3.0
"""Seconds without news from statuses that come once a second."""

Say = Callable[[str], None]


@dataclass
class Deployment:
    """Four learners, the player and a watcher, each on its own host of a virtual network."""

    lan: VirtualLan
    file: Path
    directory: Path
    running: dict[str, NodeProcess] = field(default_factory=dict)

    def start(self, host: str, command: Sequence[str]) -> None:
        self.running[host] = processes.start(host, self.lan.inside(host, command), self.directory)

    def start_network(self, hz: float) -> None:
        watcher = Path(__file__).with_name("watcher.py")
        self.start(WATCHER, [sys.executable, str(watcher), str(self.file), str(self.directory)])
        for name in LEARNERS:
            self.start(name, learner_command(name, self.file))
        self.start(PLAYER, player_command(self.file, {"hz": hz}))

    @property
    def standing(self) -> dict[str, Any]:
        """What the watcher last heard of each learner: its iteration, and whom it waits for."""
        file = self.directory / "standing.json"
        return json.loads(file.read_text(encoding="utf-8")) if file.exists() else {}

    @property
    def slowest(self) -> int:
        """The iteration that every learner has reached."""
        return min(self.standing.get(name, {}).get("iteration", 0) for name in LEARNERS)

    def wait(self, condition: Callable[[], Any], timeout: float = 60.0) -> None:
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, f"not within {timeout} s; {self.standing}, {self.lan.counts()}"
            time.sleep(0.05)

    def stall(self) -> dict[str, Any]:
        """Wait until nobody gets on any more; where everyone stands then."""
        seen, since = self.standing, time.monotonic()

        def still() -> bool:
            nonlocal seen, since
            if (news := self.standing) != seen:
                seen, since = news, time.monotonic()
            return time.monotonic() - since >= STILL

        self.wait(still)
        return seen

    def finish(self, timeout: float = 60.0) -> str:
        """Wait for the end and compare with the reference; words for what was delivered."""
        watcher = self.running[WATCHER]
        self.wait(lambda: watcher.exit_code is not None, timeout)
        assert watcher.exit_code == 0, processes.last_lines(watcher.log)
        experiment = load_experiment(self.file)
        found = np.load(self.directory / "history.npz")
        for name, reference in simulate_from_bag(experiment).items():
            for part in ("theta", "omega"):
                expected = np.stack([getattr(parameters, part) for parameters in reference])
                assert_same_bits(found[f"{name}.{part}"], expected, f"{part} of {name}")
        delivered = json.loads((self.directory / "delivered.json").read_text(encoding="utf-8"))
        graph = audit(experiment.edge_schedule, {int(n): who for n, who in delivered.items()}, experiment.iterations)
        assert graph == {"iterations": experiment.iterations, "edge_mismatches": [], "connectivity_window": 1}
        messages = sum(len(senders) for who in delivered.values() for senders in who)
        return (
            f"delivered: {len(delivered)} iterations of {len(LEARNERS)} learners, {messages} parameters between them,"
            f" every bit of theta and omega as in the reference; {frames(self.lan)}"
        )


def frames(lan: VirtualLan) -> str:
    return "frames: " + ", ".join(f"{count} {name}" for name, count in lan.counts()._asdict().items())


def words(standing: dict[str, Any], *names: str) -> str:
    return "; ".join(
        f"{name} at iteration {standing[name]['iteration']} waits for {', '.join(standing[name]['waiting_for'])}"
        for name in names
    )


def assert_same_bits(found: Any, expected: Any, what: str) -> None:
    """LearnerMetrics n - 1 of both is iteration n."""
    assert found.shape == expected.shape, what
    different = 1 + np.flatnonzero((found.view(np.uint64) != expected.view(np.uint64)).any(axis=1))
    assert not different.size, f"{what} differs at iterations {different}"


Deploy = Callable[..., Deployment]


@pytest.fixture
def deploy(make_experiment: Callable[..., Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Deploy]:
    """A function that makes a deployment of a ring of four; keywords of ``make_experiment``."""
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(FASTDDS_PROFILE))  # other tests keep to this host
    made: list[Deployment] = []
    with virtual_lan([*LEARNERS, PLAYER, WATCHER, SERVER]) as lan:

        def make(**settings: Any) -> Deployment:
            file = make_experiment(learners=len(LEARNERS), schedule=RING, **settings)
            made.append(Deployment(lan, file, tmp_path))
            return made[-1]

        try:
            yield make
        finally:
            for deployment in made:
                processes.stop(list(deployment.running.values()))


@pytest.fixture
def say(capsys: pytest.CaptureFixture[str], request: pytest.FixtureRequest) -> Say:
    """Print although the test passes, for the log of CI."""

    def print_at_once(words: str) -> None:
        with capsys.disabled():
            print(f"\n{request.node.name}: {words}", end="")  # noqa: T201 - what it is for

    return print_at_once


def test_every_process_on_a_host_of_its_own(deploy: Deploy, say: Say) -> None:
    run = deploy(iterations=20)
    run.start_network(hz=20.0)
    say(f"nothing cut; {run.finish()}")


def test_a_link_cut_for_longer_than_the_lease(deploy: Deploy, say: Say) -> None:
    run = deploy(iterations=30)
    run.start_network(hz=10.0)
    run.wait(lambda: run.slowest >= 5)
    run.lan.cut("learner_2")
    since, before = time.monotonic(), run.lan.traffic("learner_2")
    stalled = run.stall()
    assert stalled["learner_1"]["waiting_for"] == stalled["learner_3"]["waiting_for"] == ["learner_2"]
    assert {"learner_1", "learner_3"} >= set(stalled["learner_4"]["waiting_for"]) > set()
    run.wait(lambda: time.monotonic() - since >= CUT)
    assert run.standing == stalled
    assert run.lan.traffic("learner_2") == before
    run.lan.heal()
    healed = time.monotonic()
    run.wait(lambda: run.slowest > stalled["learner_2"]["iteration"] + 1)
    back = time.monotonic() - healed
    say(
        f"cable of learner_2 pulled for {healed - since:.1f} s: {words(stalled, 'learner_1', 'learner_3', 'learner_4')}"
    )
    say(f"all went on {back:.1f} s after it was plugged in again; {run.finish()}")


def test_a_tenth_of_all_datagrams_lost(deploy: Deploy, say: Say) -> None:
    run = deploy(iterations=30)
    run.lan.lose(0.1)
    run.start_network(hz=20.0)
    delivered = run.finish()
    counts = run.lan.counts()
    assert counts.fragments == 0
    share = counts.lost / (counts.lost + counts.passed)
    assert 0.08 < share < 0.12
    say(f"{counts.lost} datagrams lost, {share:.1%}; {delivered}")


def test_frames_of_1500_bytes_lost_from_large_messages(deploy: Deploy, say: Say) -> None:
    """With the shipped profile a datagram fits a frame, so that a lost frame costs what it carried and no more."""
    run = deploy(iterations=20, change={"game": LARGE_GAME})
    run.lan.set_mtu(1500)
    run.lan.lose(0.1)
    run.start_network(hz=20.0)
    delivered = run.finish()
    counts = run.lan.counts()
    assert counts.fragments == 0
    assert counts.lost > 100
    say(f"{counts.lost} frames lost; {delivered}")


@pytest.mark.slow
def test_without_the_profile_large_messages_hardly_get_through(
    deploy: Deploy, say: Say, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The same run on Fast DDS's own transport, for a minute."""
    monkeypatch.delenv("FASTRTPS_DEFAULT_PROFILES_FILE")
    monkeypatch.setenv("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    run = deploy(iterations=20, change={"game": LARGE_GAME})
    run.lan.lose(0.1)
    run.start_network(hz=20.0)
    end = time.monotonic() + 60.0
    run.wait(lambda: run.running[WATCHER].exit_code is not None or time.monotonic() > end, timeout=90.0)
    say(f"at iteration {run.slowest} after a minute; {frames(run.lan)}")
    assert run.slowest < 20
    assert run.lan.counts().fragments > 0


def test_two_halves_cut_off_from_each_other(deploy: Deploy, say: Say) -> None:
    run = deploy(iterations=30)
    run.start_network(hz=10.0)
    run.wait(lambda: run.slowest >= 5)
    run.lan.partition(["learner_1", "learner_2"])
    since = time.monotonic()
    stalled = run.stall()
    here = [set(stalled[name]["waiting_for"]) for name in ("learner_3", "learner_4")]
    assert all(here)
    assert {"learner_1", "learner_2"} & set.union(*here)
    assert run.lan.counts().cut > 0
    run.lan.heal()
    apart = time.monotonic() - since
    say(f"learners 1 and 2 cut off from all others for {apart:.1f} s: {words(stalled, 'learner_3', 'learner_4')}")
    say(run.finish())


def discovery_server(run: Deployment) -> dict[str, str]:
    """Fast DDS's own program, which comes with the wheels, on a host of its own; every process knows its address."""
    address = run.lan.hosts[SERVER].address
    program = str(Path(sys.executable).with_name("fastdds"))
    run.start(SERVER, [program, "discovery", "--server-id", "0", "--udp-address", address, "--udp-port", "11811"])
    return {"ROS_DISCOVERY_SERVER": f"{address}:11811"}


def static_peers(run: Deployment) -> dict[str, str]:
    """Every host knows the addresses of all."""
    return {"ROS_STATIC_PEERS": ";".join(host.address for host in run.lan.hosts.values())}


@pytest.mark.parametrize("way", [discovery_server, static_peers])
def test_without_multicast(
    deploy: Deploy, say: Say, monkeypatch: pytest.MonkeyPatch, way: Callable[[Deployment], dict[str, str]]
) -> None:
    run = deploy(iterations=20)
    run.lan.drop_multicast()
    for name, value in way(run).items():
        monkeypatch.setenv(name, value)
    run.start_network(hz=20.0)
    say(f"multicast dropped; {run.finish()}")


def test_without_multicast_and_without_help_nobody_finds_anybody(deploy: Deploy, say: Say) -> None:
    """Else the test above would show nothing."""
    run = deploy(iterations=20)
    run.lan.drop_multicast()
    run.start_network(hz=20.0)
    run.wait(lambda: run.lan.counts().multicast >= 200)
    assert run.standing == {}
    say(f"multicast dropped: nobody found anybody; {frames(run.lan)}")
