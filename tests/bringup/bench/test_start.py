"""The start benchmark: its targets, and one round of it."""

from pathlib import Path

import pytest
from bench_command import printed

from mabirds_bringup.bench.start.measure import TARGETS, targets, until_ended


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
