"""Keystores, enforced by a real implementation of DDS Security.

The ROS wheels come without one, so these tests need Fast DDS 2 with security and its headers (Debian and Ubuntu: the
package libfastrtps-dev), where the compiler finds them, or below the directory that MABIRDS_FAST_DDS names
(tools/fetch_fast_dds.sh fills one).
"""

import os
import shutil
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from cryptography import x509
from cryptography.hazmat.primitives.serialization import load_pem_private_key

from mabirds_bringup.security import keystore as keystores
from mabirds_bringup.security.permissions import Validity, permissions_xml
from mabirds_bringup.security.policy import Access, Policy
from mabirds_core.experiment.file import load_experiment

SOURCE = Path(__file__).with_name("test_security_peer.cpp")
LIBRARIES = ("-lfastrtps", "-lfastcdr")
PATIENCE = 20.0
SHORT = 4.0
"""Seconds in which processes that may talk to each other have long done so."""

NOW = datetime.now(UTC).replace(microsecond=0)
VALIDITY = Validity(NOW - timedelta(days=1), NOW + timedelta(days=1))
LINE = {"kind": "slots", "slots": [[["learner_1", "learner_2"], ["learner_2", "learner_3"]]], "undirected": True}

Peer = Callable[..., list[str]]


@pytest.fixture(scope="module", autouse=True)
def fast_dds() -> Iterator[None]:
    """Let compiler and loader look below MABIRDS_FAST_DDS, in these tests only: ROS has a Fast DDS of its own."""
    with pytest.MonkeyPatch.context() as patch:
        if prefix := os.environ.get("MABIRDS_FAST_DDS"):
            places = [str(place) for place in Path(prefix).glob("usr/lib/*-linux-gnu")]
            headers = [str(place) for place in (Path(prefix) / "usr/include", *Path(prefix).glob("usr/include/*-gnu"))]
            for name, found in (("CPATH", headers), ("LIBRARY_PATH", places), ("LD_LIBRARY_PATH", places)):
                patch.setenv(name, os.pathsep.join(found), prepend=os.pathsep)
        yield


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The peer, compiled; skips where there is no Fast DDS to compile it with."""
    compiler = shutil.which("g++")
    if compiler is None:
        pytest.skip("g++ is not installed")
    header = ["-include", "fastdds/dds/domain/DomainParticipant.hpp", "-x", "c++", "-E", os.devnull, "-o", os.devnull]
    if subprocess.run([compiler, *header], capture_output=True, check=False).returncode != 0:
        pytest.skip("the headers of Fast DDS 2 are not installed (Debian and Ubuntu: apt-get install libfastrtps-dev)")
    made = tmp_path_factory.mktemp("peer") / "peer"
    command = [compiler, "-std=c++17", "-o", made, SOURCE, *LIBRARIES]
    built = subprocess.run(command, capture_output=True, text=True, check=False)
    assert built.returncode == 0, built.stderr
    return made


@pytest.fixture
def peer(program: Path, ros_domain: int) -> Peer:
    """A function that runs a peer to its end and returns what it said."""

    def run(enclave: Path | None, *topics: str, seconds: float = PATIENCE, domain: int = ros_domain) -> list[str]:
        command = [program, enclave or "-", str(domain), str(seconds), *topics]
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
        return [line for line in done.stdout.splitlines() if line.startswith(("participant ", "w:", "r:"))]

    return run


@pytest.fixture
def processes(make_experiment: Callable[..., Path]) -> tuple[Access, ...]:
    return Policy(load_experiment(make_experiment(learners=3, schedule=LINE))).processes()


@pytest.fixture
def enclaves(processes: tuple[Access, ...], tmp_path: Path, ros_domain: int) -> Path:
    keystores.create_keystore(tmp_path / "keystore", processes, ros_domain, VALIDITY)
    return tmp_path / "keystore" / "enclaves"


@pytest.fixture
def strangers(processes: tuple[Access, ...], tmp_path: Path, ros_domain: int) -> Path:
    """The same, made by somebody else."""
    keystores.create_keystore(tmp_path / "strange", processes, ros_domain, VALIDITY)
    return tmp_path / "strange" / "enclaves"


@pytest.fixture
def speaker(program: Path, ros_domain: int) -> Iterator[Callable[[Path | None, str], None]]:
    """A function that starts a process which publishes on a topic until the test ends."""
    started: list[subprocess.Popen[bytes]] = []

    def speak(enclave: Path | None, topic: str) -> None:
        command = [program, enclave or "-", str(ros_domain), "60", f"w:{topic}"]
        started.append(subprocess.Popen(command, stdout=subprocess.DEVNULL))

    yield speak
    for process in started:
        process.kill()
        process.wait()


def test_a_learner_can_do_what_its_policy_says_and_nothing_else(enclaves: Path, peer: Peer) -> None:
    allowed = (
        "w:rt/learner_1/parameters",
        "w:rt/learner_1/status",
        "w:rt/parameter_events",
        "w:ros_discovery_info",
        "w:rq/learner_2/fetch_parametersRequest",
        "w:rr/learner_1/fetch_parametersReply",
        "r:rt/learner_1/demonstration",
        "r:rt/learner_2/parameters",
        "r:rr/learner_2/fetch_parametersReply",
    )
    refused = (
        "w:rt/learner_2/parameters",
        "w:rt/learner_1/demonstration",
        "w:rt/mabirds_security_probe",
        "w:rr/learner_2/fetch_parametersReply",
        "r:rt/learner_2/demonstration",
        "r:rt/learner_3/parameters",
        "r:rr/learner_3/fetch_parametersReply",
    )
    said = peer(enclaves / "learner_1", *allowed, *refused, seconds=0)
    assert said == [
        "participant made",
        *(f"{topic} allowed" for topic in allowed),
        *(f"{topic} refused" for topic in refused),
    ]


@pytest.mark.parametrize("enclave", ["expert_player", "monitor", "inspector", "dashboard", "drawing", "picture"])
def test_everybody_can_join(enclaves: Path, peer: Peer, enclave: str) -> None:
    said = peer(enclaves / enclave, "w:rt/rosout", "w:rt/learner_1/parameters", seconds=0)
    assert said == ["participant made", "w:rt/rosout allowed", "w:rt/learner_1/parameters refused"]


def test_drawings_may_have_any_name_below_drawn_and_no_other(
    enclaves: Path, peer: Peer, speaker: Callable[[Path | None, str], None]
) -> None:
    """What permissions say by a pattern is opened, heard by those who may hear it, and by nobody else."""
    number, grid = "rt/learner_1/drawn/scalars/omega_norm", "rt/learner_1/drawn/costs/expert_1"
    allowed = (f"w:{number}", f"w:{grid}", "w:rt/drawn/consensus/theta", "r:rt/learner_2/parameters")
    refused = ("w:rt/learner_1/parameters", "w:rt/learner_1/drawn", "w:rt/drawn/other", "r:rt/learner_1/demonstration")
    said = peer(enclaves / "drawing", *allowed, *refused, seconds=0)
    assert said[1:] == [*(f"{topic} allowed" for topic in allowed), *(f"{topic} refused" for topic in refused)]
    said = peer(enclaves / "inspector", f"r:{grid}", f"w:{grid}", f"r:{number}", seconds=0)
    assert said[1:] == [f"r:{grid} allowed", f"w:{grid} refused", f"r:{number} refused"]
    speaker(enclaves / "drawing", grid)
    assert f"r:{grid} received" in peer(enclaves / "picture", f"r:{grid}")


@pytest.mark.parametrize("zone", ["UTC", "Asia/Tokyo", "America/Los_Angeles", "Etc/GMT+12"])
def test_a_fresh_keystore_holds_in_every_time_zone(
    enclaves: Path, peer: Peer, monkeypatch: pytest.MonkeyPatch, zone: str
) -> None:
    monkeypatch.setenv("TZ", zone)
    assert peer(enclaves / "learner_1", seconds=0) == ["participant made"]


def test_in_another_domain_nothing_is_allowed(enclaves: Path, peer: Peer, ros_domain: int) -> None:
    said = peer(enclaves / "learner_1", "w:rt/parameter_events", seconds=0, domain=ros_domain + 1)
    assert "w:rt/parameter_events allowed" not in said


def test_parameters_reach_the_neighbour_and_nobody_else(
    enclaves: Path, strangers: Path, peer: Peer, speaker: Callable[[Path | None, str], None]
) -> None:
    """Neither a process without security nor one with the same names from another keystore."""
    topic = "rt/learner_2/parameters"
    speaker(enclaves / "learner_2", topic)
    with ThreadPoolExecutor() as pool:
        neighbour = pool.submit(peer, enclaves / "learner_1", f"r:{topic}")
        outsiders = [
            pool.submit(peer, enclave, f"r:{topic}", seconds=SHORT) for enclave in (None, strangers / "learner_1")
        ]
    assert f"r:{topic} received" in neighbour.result()
    for outsider in outsiders:
        assert outsider.result() == ["participant made", f"r:{topic} allowed"]


def test_nobody_else_can_speak_for_a_learner(
    enclaves: Path, strangers: Path, peer: Peer, speaker: Callable[[Path | None, str], None]
) -> None:
    topic = "rt/learner_2/parameters"
    speaker(None, topic)
    speaker(strangers / "learner_2", topic)
    assert peer(enclaves / "learner_1", f"r:{topic}", seconds=SHORT) == ["participant made", f"r:{topic} allowed"]
    speaker(enclaves / "learner_2", topic)
    assert f"r:{topic} received" in peer(enclaves / "learner_1", f"r:{topic}")


@pytest.mark.parametrize("signer", ["itself", "an authority of its own"])
def test_a_learner_cannot_give_itself_permissions(
    enclaves: Path,
    strangers: Path,
    processes: tuple[Access, ...],
    peer: Peer,
    speaker: Callable[[Path | None, str], None],
    ros_domain: int,
    signer: str,
) -> None:
    """learner_1, with its true key and certificate, wants learner_2's demonstrations."""
    folder, topic = enclaves / "learner_1", "rt/learner_2/demonstration"
    greedy = next(process for process in processes if process.enclave == "/learner_1")
    greedy = Access(**{**vars(greedy), "subscribe": (*greedy.subscribe, topic.removeprefix("rt"))})
    private, public = folder / "key.pem", folder / "cert.pem"
    if signer == "an authority of its own":
        private = strangers.parent / "private" / "permissions_ca.key.pem"
        public = strangers.parent / "public" / "permissions_ca.cert.pem"
        for name in ("permissions_ca.cert.pem", "governance.p7s"):
            (folder / name).unlink()
            shutil.copy(strangers / "learner_1" / name, folder / name)
    sign(folder, permissions_xml(greedy, ros_domain, VALIDITY), private, public)
    speaker(enclaves / "expert_player", topic)
    assert f"r:{topic} received" not in peer(folder, f"r:{topic}", seconds=SHORT)
    assert f"r:{topic} received" in peer(enclaves / "learner_2", f"r:{topic}")


def sign(folder: Path, document: bytes, private: Path, public: Path) -> None:
    key = load_pem_private_key(private.read_bytes(), None)
    signer = keystores.Identity(x509.load_pem_x509_certificate(public.read_bytes()), key)  # type: ignore[arg-type]
    keystores._write_signed(folder / "permissions.xml", document, signer)
