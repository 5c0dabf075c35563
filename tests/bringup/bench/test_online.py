"""The benchmark of rates: its targets, and one short round through ROS."""

from pathlib import Path

import pytest
import yaml

from mabirds_bringup.bench.online.compare import METHODS, bound, compare, targets


def test_targets() -> None:
    found = targets({"one": {"times_of_rival": 1.1}, "other": {"times_of_rival": 0.9}})
    assert [(target["met"], target["at_most"]) for target in found] == [(True, False), (False, False)]


def test_the_bound_is_the_rate_at_which_all_processors_are_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mabirds_bringup.bench.online.compare.processors", lambda: 2)
    assert bound({"processor_milliseconds": 3.0, "player_milliseconds": 2.0}, 2) == 250.0


@pytest.mark.timeout(180)
def test_one_round(experiment_file: Path) -> None:
    """Every method learns all demonstrations of a small experiment, and is timed."""
    found = compare(experiment_file, 30, 1)
    assert {name.partition("_")[0] for name in found} == {*METHODS, "times"}
    assert min(found.values()) > 0
    assert found["times_of_rival"] == pytest.approx(found["mabirds_rate"] / found["bics_rate"])


@pytest.fixture
def experiment_file(tmp_path: Path) -> Path:
    game = {"map": "...\n...", "starts": [[[0, 0], [0, 2]]], "goals": [[0, 2], [0, 0]], "horizon": 6}
    content = {
        "name": "online",
        "game": game,
        "learners": ["learner_1", "learner_2"],
        "schedule": {"kind": "static"},
        "demonstrations": {"bag": "bag", "per_learner": 5, "period": 1.0},
        "iterations": 5,
    }
    file = tmp_path / "online.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file
