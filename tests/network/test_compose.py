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
from safetensors.numpy import load_file

from mabirds_bringup.namespaces import obstacle
from mabirds_bringup.verbs.simulate import simulate_from_bag
from mabirds_core.experiment import load_experiment

OBSTACLE = obstacle()
pytestmark = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")

LAYOUT = Path(__file__).resolve().parents[2] / "docker" / "layout.py"


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
    command = [sys.executable, str(LAYOUT), "--json", "--out", str(tmp_path / "runs"), *options]
    return subprocess.run(command, env=dict(variables), capture_output=True, text=True, timeout=150, check=False)


def assert_as_in_one_process(history: Mapping[str, Any], found: dict[str, Any]) -> None:
    """All iterations by the checkpoints, and what was printed of the last one."""
    for name, reference in history.items():
        place = Path(found["directory"]) / "volumes" / name
        for iteration, expected in enumerate(reference, start=1):
            arrays = load_file(place / f"{iteration:08}.safetensors")
            for part in ("theta", "omega"):
                assert arrays[part].tobytes() == getattr(expected, part).tobytes(), f"{part} of {name}, {iteration}"
        last = {part: np.ascontiguousarray(getattr(reference[-1], part)) for part in ("theta", "omega")}
        assert found["learners"][name] == {part: hashlib.sha256(last[part]).hexdigest() for part in last}


def test_the_layout_of_the_containers_equals_the_reference(tmp_path: Path, variables: dict[str, str]) -> None:
    done = layout(tmp_path, variables, "--timeout", "120")
    assert done.returncode == 0, done.stderr
    found = json.loads(done.stdout)
    history = simulate_from_bag(load_experiment(Path(variables["MABIRDS_CONFIG"]) / "small.yaml"))
    assert found["learners"].keys() == history.keys()
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
