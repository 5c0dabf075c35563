"""``mabirds evaluate``: what was learned from recordings, beside what learns nothing."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from robot_recordings import RULES, robots_bag
from typer.main import get_command

from mabirds_bringup.application import app
from mabirds_bringup.evaluate.recordings import LEARNERS, SHOWN, estimate


def mabirds(*words: object) -> None:
    get_command(app)([*map(str, words)], standalone_mode=False)


def test_recordings_become_patrols_that_are_learned_tuned_and_judged(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robots_bag(tmp_path / "recording", count=12)
    rules = {**RULES, "held_out": 0.4, "game": {"kind": "patrol"}, "learners": {"count": 2, "passes": 4}}
    (tmp_path / "rules.yaml").write_text(yaml.safe_dump(rules))
    mabirds("import", "recording", "--rules", "rules.yaml", "--out", "mine")
    mabirds("tune", "mine/experiment.yaml", "--folds", 2, "--out", "mine/tuned.yaml")
    mabirds("simulate", "mine/tuned.yaml")
    capfd.readouterr()
    mabirds("evaluate", "runs/latest", "--bag", "mine/held_out", "--samples", 5, "--json")
    rows = json.loads(capfd.readouterr().out)["rows"]
    baselines = ("uniform", "counting", "constant velocity", "straight to the goal", "maximum entropy, goals told")
    nats = {name: rows[name]["nats"]["mean"] for name in (LEARNERS, *baselines)}
    assert nats["uniform"] == pytest.approx(0.0, abs=1e-9)
    assert nats[LEARNERS] > max(nats["maximum entropy, goals told"], nats["constant velocity"])
    assert rows[SHOWN]["conflicts"] == {"sharing": 0.0, "swapping": 0.0}


def test_intervals_are_those_of_means() -> None:
    values = np.random.default_rng(0).normal(3.0, 2.0, 400)
    mean, low, high = estimate(values, seed=1)
    half = 1.96 * values.std() / 20
    assert mean == pytest.approx(values.mean())
    assert (low, high) == (pytest.approx(mean - half, abs=0.03), pytest.approx(mean + half, abs=0.03))


def test_a_run_is_judged_by_the_recordings_that_were_held_out(
    tmp_path: Path, capfd: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    robots_bag(tmp_path / "recording", count=12)
    (tmp_path / "rules.yaml").write_text(yaml.safe_dump({**RULES, "held_out": 0.4}))
    mabirds("import", "recording", "--rules", "rules.yaml", "--out", "mine")
    mabirds("simulate", "mine/experiment.yaml")
    capfd.readouterr()
    mabirds("evaluate", "runs/latest", "--bag", "mine/held_out", "--samples", 5, "--json")
    told = json.loads(capfd.readouterr().out)
    rows = told["rows"]
    assert rows["uniform"]["nats"]["mean"] == pytest.approx(0.0, abs=1e-9)
    learners = [rows[name]["nats"]["mean"] for name in ("learner_1", "learner_2")]
    assert rows[LEARNERS]["nats"]["mean"] == pytest.approx(np.mean(learners))
    assert min(learners) > rows["counting"]["nats"]["mean"] > 0
    for row in rows.values():
        if row["average"]:
            assert row["average_best"]["mean"] <= row["average"]["mean"]
    assert rows[SHOWN]["conflicts"] == {"too close": 0.0}
    assert json.loads(Path("runs/latest/held_out.json").read_text()) == told
