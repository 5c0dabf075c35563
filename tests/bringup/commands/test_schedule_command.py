"""``mabirds schedule`` as people and scripts use it."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml
from PIL import Image

from mabirds_core.experiment.file import load_experiment

MABIRDS = str(Path(sys.executable).with_name("mabirds"))


def schedule(*arguments: object, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [MABIRDS, "schedule", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=60, check=False)


def test_check_reports_the_assumptions_and_draws(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    file = make_experiment(learners=4, schedule={"kind": "alternating"})
    result = schedule("check", file, "--png", "slots.png", "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    content = json.loads(result.stdout)
    assert (content["connectivity_window"], content["end"], len(content["slots"])) == (2, "repeat", 2)
    assert content["smallest_weight"] == pytest.approx(0.5)
    assert content["contraction"] == pytest.approx(0, abs=1e-12)  # two rounds of pairs average four exactly
    assert content["slots"][0]["row_sums"] == pytest.approx([1] * 4)
    assert ["learner_1", "learner_2"] in content["slots"][0]["edges"]
    assert "B = 2 iterations" in result.stderr
    assert "joint actions, horizon" in result.stderr
    assert content["size"]["states"] > 1
    with Image.open(tmp_path / "slots.png") as image:
        assert image.size[0] > 300


def test_check_refuses_an_impossible_schedule_by_name(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    file = make_experiment(learners=3)
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    slots = [[["learner_1", "learner_2"], ["learner_2", "learner_1"]]]
    file.write_text(yaml.safe_dump({**content, "schedule": {"kind": "slots", "slots": slots}}), encoding="utf-8")
    result = schedule("check", file, cwd=tmp_path)
    assert result.returncode == 2
    assert "learner_1 knows ever reaches learner_3" in " ".join(result.stderr.split())
    assert result.stdout == ""


@pytest.mark.parametrize("kind", ["complete", "ring", "alternating_ring", "directed_ring", "random_matching", "gossip"])
def test_what_make_writes_can_be_put_into_an_experiment(
    kind: str, make_experiment: Callable[..., Path], tmp_path: Path
) -> None:
    made: dict[str, Any] = yaml.safe_load(schedule("make", kind, "--learners", 5, cwd=tmp_path).stdout)
    file = make_experiment()
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    file.write_text(yaml.safe_dump({**content, **made}), encoding="utf-8")
    assert len(load_experiment(file).edge_schedule.learners) == 5


def test_make_writes_a_file(tmp_path: Path) -> None:
    result = schedule("make", "gossip", "--slots", 9, "--out", "made.yaml", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert len(yaml.safe_load((tmp_path / "made.yaml").read_text(encoding="utf-8"))["schedule"]["slots"]) == 9


def test_make_refuses_too_few_slots(tmp_path: Path) -> None:
    result = schedule("make", "gossip", "--learners", 9, "--slots", 3, cwd=tmp_path)
    assert result.returncode == 2
    assert "take more slots, at least 8" in " ".join(result.stderr.split())
