"""The containers' layout in network namespaces: healthy, and every bit as in one process."""

import hashlib
import json
import os
import shutil
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from identity import bits
from namespaces import obstacle

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_core.experiment.file import load_experiment
from mabirds_learner.checkpoint import owner_of
from mabirds_learner.parameters_log import ParametersLog
from mabirds_msgs_py.security import KEYSTORE, STRATEGY, check_settings

OBSTACLE = obstacle()
pytestmark = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")

DOCKER = Path(__file__).resolve().parents[2] / "docker"
LEARNERS = [f"learner_{number}" for number in range(1, 5)]
SECURE = ["--compose", str(DOCKER / "compose.yaml"), "--compose", str(DOCKER / "compose.secure.yaml")]


@pytest.fixture
def variables(make_experiment: Callable[..., Path], tmp_path: Path) -> dict[str, str]:
    """A small experiment of four learners at the places that compose.yaml expects, and variables that say so."""
    made = make_experiment(learners=4, iterations=12, schedule={"kind": "alternating"}, change={"closing_rounds": 2})
    shutil.move(made.with_name("bag"), tmp_path / "bags" / "small")
    config = tmp_path / "ros_ws" / "config"
    config.mkdir(parents=True)
    settings = yaml.safe_load(made.read_text(encoding="utf-8"))
    settings["demonstrations"]["bag"] = "../../bags/small"
    (config / "small.yaml").write_text(yaml.safe_dump(settings), encoding="utf-8")
    return {
        "MABIRDS_CONFIG": str(config),
        "MABIRDS_BAGS": str(tmp_path / "bags"),
        "MABIRDS_EXPERIMENT": "small.yaml",
        "MABIRDS_RATE": "2.0",
        "PATH": os.environ["PATH"],
    }


def layout(tmp_path: Path, variables: Mapping[str, str], *options: str) -> "subprocess.CompletedProcess[str]":
    command = [sys.executable, str(DOCKER / "layout.py"), "--json", "--out", str(tmp_path / "runs"), *options]
    return subprocess.run(command, env=dict(variables), capture_output=True, text=True, timeout=150, check=False)


def assert_as_in_one_process(history: Mapping[str, Any], found: dict[str, Any]) -> None:
    """All iterations by the checkpoints, and what was printed of the last one."""
    for name, reference in history.items():
        file = Path(found["directory"]) / "volumes" / name / "parameters.log"
        owner = owner_of(file.parent)
        assert owner
        kept = ParametersLog(file, reference[0], owner.experiment_digest)
        for iteration, expected in enumerate(reference, start=1):
            assert bits(kept[iteration]) == bits(expected), f"{name}, {iteration}"
        last = {part: np.ascontiguousarray(getattr(reference[-1], part)) for part in ("theta", "omega")}
        assert found["learners"][name] == {part: hashlib.sha256(last[part]).hexdigest() for part in last}


def test_the_layout_of_the_containers_equals_the_reference(tmp_path: Path, variables: dict[str, str]) -> None:
    done = layout(tmp_path, variables, "--timeout", "120")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    history = simulate_from_bag(load_experiment(Path(variables["MABIRDS_CONFIG"]) / "small.yaml"))
    assert list(found["learners"]) == list(history) == LEARNERS
    assert all(len(reference) == 1 + 12 + 2 for reference in history.values())
    assert_as_in_one_process(history, found)
    logs = Path(found["directory"]) / "logs"
    said = (logs / "inspect.log").read_text(encoding="utf-8")
    assert all(f"/{name} parameters" in said for name in history)
    for name in (*history, "expert_player"):
        assert f"{name}: " in (logs / f"{name}.health").read_text(encoding="utf-8")


def test_a_service_that_ends_ends_all_by_name(tmp_path: Path, variables: dict[str, str]) -> None:
    """Here a learner that the experiment does not name."""
    file = Path(variables["MABIRDS_CONFIG"]) / "small.yaml"
    settings = yaml.safe_load(file.read_text(encoding="utf-8"))
    file.write_text(yaml.safe_dump({**settings, "learners": settings["learners"][:3]}), encoding="utf-8")
    done = layout(tmp_path, variables, "--timeout", "60")
    assert done.returncode == 3
    assert "learner_4 ended with code 2" in done.stderr
    assert "'learner_4' is none of the learners" in done.stderr


def without_security() -> bool:
    """Was the middleware of this Python built without security?"""
    libraries = Path(sys.prefix, "lib").glob("libfastrtps.so.*.*.*")
    return any(b"DDS:Auth:PKI-DH" not in library.read_bytes() for library in libraries)


@pytest.mark.skipif(not without_security(), reason="needs a middleware without security")
def test_the_secure_layout_has_all_that_security_takes_but_the_middleware(
    tmp_path: Path, variables: dict[str, str]
) -> None:
    """A node looks at its settings and its enclave before it asks the middleware, which says no here."""
    done = layout(tmp_path, variables, "--timeout", "60", *SECURE)
    assert done.returncode == 3
    assert "ended with code 2" in done.stderr
    assert "rmw_fastrtps_cpp cannot start with security" in done.stderr
    volumes = next((tmp_path / "runs").glob("*-layout")) / "volumes"
    keys = [volumes / f"keys_{name}" for name in (*LEARNERS, "expert_player", "inspector")]
    for place in keys:
        check_settings([], {STRATEGY: "Enforce", KEYSTORE: str(as_keystore(place))})
        assert not any(file.is_symlink() for file in place.iterdir())
    assert len({(place / "key.pem").read_bytes() for place in keys}) == len(keys)


def as_keystore(enclave: Path) -> Path:
    """A keystore with this as its enclave /, like the one that a container has with its own."""
    keystore = enclave.with_name(f"{enclave.name}.keystore")
    keystore.mkdir()
    (keystore / "enclaves").symlink_to(enclave)
    return keystore
