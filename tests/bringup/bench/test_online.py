"""The benchmark of rates: its targets, and one short round through ROS."""

import os
import sys
import time
from pathlib import Path

import pytest
import yaml

from mabirds_bringup.bench.exchange.measure import processor_seconds
from mabirds_bringup.bench.online.compare import METHODS, bound, compare, require_room, targets
from mabirds_bringup.bench.online.shares import GROUPS, shared_out
from mabirds_bringup.run.processes import start, stop
from mabirds_core.errors import MabirdsError


def test_targets() -> None:
    found = targets({"one": {"times_of_rival": 1.1}, "other": {"times_of_rival": 0.9}})
    assert [(target["met"], target["at_most"]) for target in found] == [(True, False), (False, False)]


def test_the_bound_is_the_rate_at_which_all_processors_are_busy(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mabirds_bringup.bench.online.compare.processors", lambda: 2)
    assert bound({"processor_milliseconds": 3.0, "player_milliseconds": 2.0}, 2) == 250.0


def test_shares_beyond_the_processors_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mabirds_bringup.bench.online.compare.processors", lambda: 2)
    require_room(0.5, 3)
    require_room(1.0, 3)
    with pytest.raises(MabirdsError, match="3 processes would need 2.1 processors, and there are 2; at most 0.67"):
        require_room(0.7, 3)


CONTROLLER = GROUPS if (GROUPS / "cgroup.controllers").exists() else GROUPS / "cpu"


@pytest.mark.skipif(not os.access(CONTROLLER, os.W_OK), reason="this user cannot make control groups")
def test_a_process_gets_its_share_and_no_more(tmp_path: Path) -> None:
    with shared_out(0.2) as shares:
        process = start("busy", [sys.executable, "-c", "while True: pass"], tmp_path)
        try:
            shares.limit(process)
            begin, before = time.monotonic(), processor_seconds(process.popen.pid)
            time.sleep(1.5)  # in which it is measured
            used = (processor_seconds(process.popen.pid) - before) / (time.monotonic() - begin)
        finally:
            stop([process])
    assert 0.05 < used < 0.3


def test_who_cannot_be_limited_is_told_how(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("mabirds_bringup.bench.online.shares.GROUPS", tmp_path / "nowhere")
    process = start("short", [sys.executable, "-c", "pass"], tmp_path)
    with shared_out(0.2) as shares, pytest.raises(MabirdsError, match="--share 0.2: .*run it as root"):
        shares.limit(process)
    stop([process])


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
