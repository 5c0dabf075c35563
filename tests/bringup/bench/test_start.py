"""The start benchmark: its targets, and one round of it."""

import os
import sys
from pathlib import Path

import pytest
from bench_command import printed

from mabirds_bringup.bench.start.measure import TARGETS, targets, until_ended
from mabirds_bringup.bench.start.parts import STEPS, bytecode_kept


def test_targets() -> None:
    assert [target["met"] for target in targets({"help_seconds": 0.2, "learner_times_of_bare": 1.4})] == [True, False]


def test_a_commands_time_is_the_processors(tmp_path: Path) -> None:
    busy, idle = "t=__import__('time')\nwhile t.process_time() < 0.5: pass", "__import__('time').sleep(0.5)"
    assert until_ended(["python", "-c", busy]) - until_ended(["python", "-c", idle]) == pytest.approx(0.5, abs=0.2)


@pytest.mark.timeout(120)
def test_one_round(tmp_path: Path) -> None:
    content = printed(tmp_path, "start", "--repetitions", "1")
    assert [target["name"] for target in content["targets"]] == list(TARGETS)
    results = content["results"]
    assert results["help_seconds"] < 2 * results["patrol_seconds"]
    assert results["bare_seconds"] < results["patrol_seconds"]
    assert results["bare_megabytes"] < results["patrol_megabytes"]
    steps = [results[f"to_{step}_seconds"] for step in STEPS]
    assert steps[0] < min(steps[1:])


def test_processes_keep_bytecode_where_this_one_must_not(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYTHONDONTWRITEBYTECODE", "1")
    monkeypatch.delenv("PYTHONPYCACHEPREFIX", raising=False)
    with bytecode_kept(tmp_path):
        until_ended([sys.executable, "-c", "import mabirds_bringup"])
    assert list(tmp_path.rglob("*.pyc"))
    assert os.environ["PYTHONDONTWRITEBYTECODE"] == "1"
    assert "PYTHONPYCACHEPREFIX" not in os.environ
