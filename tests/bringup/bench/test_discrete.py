"""The discrete benchmark: its tables worked out by hand, and the command on a small experiment."""

import gzip
import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mabirds_bringup.bench.cases import Case, shortened
from mabirds_bringup.bench.discrete.cases import HARD, MAIN, VARIATIONS, all_cases
from mabirds_bringup.bench.discrete.figures import error_curves
from mabirds_bringup.bench.discrete.outcome import Outcome, run_case
from mabirds_bringup.bench.discrete.tables import COLUMNS, rows, table
from mabirds_bringup.bench.discrete.targets import agreement, targets
from mabirds_bringup.bench.tables import spread, time_to
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.metrics.metrics import constraint_errors

MABIRDS = [str(Path(sys.executable).with_name("mabirds"))]
REPOSITORY = Path(__file__).resolve().parents[3]
SOFT = {"algorithm": {"steps": {"alpha": 8.0, "beta": 4.0}, "expectation": "exact"}}


def outcome(label: str = "MA-BIRDS", learner: str = "learner_1", seed: int = 1, **changes: Any) -> Outcome:
    """Made up: two updates of 2 s and 3 s."""
    values: dict[str, Any] = {
        "group": MAIN,
        "label": label,
        "learner": learner,
        "seed": seed,
        "violation_rate": [0.9, 0.5, 0.0],
        "success_rate": [0.0, 0.5, 1.0],
        "false_positive_rate": 0.02,
        "false_negative_rate": 0.0,
        "seconds": [2.0, 3.0],
        "gradient_steps": 2,
        "policy_solves": 4,
        "cost_of_true": [0.1, 0.3],
        "cost_of_harmless": [-1.0, 0.2],
        "learned": [3, 4],
        "visits": [[1.0]],
    }
    return Outcome(**{**values, **changes})


def test_a_spread_is_the_mean_and_half_of_the_range() -> None:
    found = spread([0.1, 0.2, 0.6])
    assert (found.mean, found.half_width) == pytest.approx((0.3, 0.25))
    assert str(found) == "0.300 ± 0.250"


@pytest.mark.parametrize(("level", "time"), [(0.5, 2.0), (0.9, 5.0), (0.0, 0.0), (1.1, None)])
def test_the_time_to_a_level_adds_the_updates_before_it(level: float, time: float | None) -> None:
    assert time_to(outcome(), level) == time


def test_a_row_holds_means_over_seeds() -> None:
    other = outcome(seed=2, violation_rate=[1.0, 1.0, 0.2], seconds=[1.0, 2.0], success_rate=[0.0, 0.6, 0.8])
    (row,) = rows([outcome(), other])
    assert row.name == "MA-BIRDS learner_1"
    assert (row.violation_rate.mean, row.violation_rate.half_width) == pytest.approx((0.1, 0.1))
    assert row.iteration_seconds == pytest.approx(2.0)
    assert row.seconds_to_level == (pytest.approx(1.5), None)
    assert (row.iterations, row.gradient_steps) == (2, 2)


def test_times_are_multiples_of_the_fastest_and_work_is_per_iteration() -> None:
    slow = outcome(
        "FTL", "ftl", seconds=[8.0, 12.0], success_rate=[0.0, 0.0, 0.95], gradient_steps=20, policy_solves=22
    )
    lines = [dict(zip(COLUMNS, line, strict=True)) for line in table(rows([outcome(), slow]))]
    assert [line[""] for line in lines] == ["MA-BIRDS learner_1", "FTL"]
    assert [line["STPOI"] for line in lines] == ["1.000", "4.000"]
    assert [line["50% ST"] for line in lines] == ["1.000", "10.000"]
    assert [line["90% ST"] for line in lines] == ["1.000", "4.000"]
    assert [line["gradient steps"] for line in lines] == ["1.0", "10.0"]
    never = outcome("DLM", "dlm", success_rate=[0.0, 0.0, 0.0])
    assert table(rows([outcome(), never]))[1][6:8] == ["never", "never"]


def test_learners_agree_where_their_constraint_sets_are_equal() -> None:
    same, other = outcome(learner="learner_2"), outcome(learner="learner_2", learned=[3])
    assert agreement([outcome(), same]) == {1: True}
    assert agreement([outcome(), other]) == {1: False}
    assert agreement([outcome(), same, outcome("BICS", "bics", learned=[9])]) == {1: True}


def test_targets_say_what_is_met_and_what_is_missed() -> None:
    bad = outcome(learner="learner_2", false_positive_rate=0.04)
    ftl, dlm = (outcome(name, name.lower(), seconds=[9.0, 11.0 + extra]) for name, extra in (("FTL", 40), ("DLM", 0)))
    found = {one.name: one.met for one in targets([outcome(), bad, ftl, dlm])}
    assert found["MA-BIRDS learner_1 false_positive_rate"] is True
    assert found["MA-BIRDS learner_2 false_positive_rate"] is False
    assert found["MA-BIRDS learner_2 success_rate"] is True
    assert found["FTL time an iteration / MA-BIRDS"] is True
    assert found["DLM time an iteration / MA-BIRDS"] is False
    assert found["seeds with one constraint set"] is True


def test_error_curves_give_the_rates_of_every_threshold() -> None:
    one = outcome(cost_of_true=[0.1, 0.3, 5.0], cost_of_harmless=[-1.0, 0.2])
    mask, omega = np.array([True] * 3 + [False] * 2), -np.array([0.1, 0.3, 5.0, -1.0, 0.2])
    for threshold, false_positive, false_negative in zip(*error_curves([one]), strict=True):
        assert (false_positive, false_negative) == pytest.approx(constraint_errors(omega, mask, threshold))


def mabirds(*arguments: object, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [*MABIRDS, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=180, check=False)


def shipped() -> tuple[Experiment, Experiment]:
    names = ("discrete.yaml", "discrete_many_starts.yaml")
    first, second = (load_experiment(REPOSITORY / "ros_ws" / "config" / name) for name in names)
    return first, second


def test_the_shipped_game_has_enough_true_constraints() -> None:
    from mabirds_core.experiment.assembly import build_game

    for experiment in shipped():
        assert build_game(experiment).true_constraints.sum() >= 77


def test_the_cases_are_all_methods_and_all_variations() -> None:
    cases = all_cases(*shipped())
    assert [case.label for case in cases if case.group == MAIN] == ["MA-BIRDS", "BICS", "FTL", "DLM", "ME-greedy"]
    by_label = {case.label: case.experiment for case in cases if case.group == VARIATIONS}
    for count in (2, 4, 8):
        ring = by_label[f"{count} learners on an alternating ring"]
        assert (len(ring.learners), ring.schedule.kind) == (count, "alternating")
    assert by_label["neural reward"].algorithm.reward.kind == "neural"
    assert by_label["soft Q-learning"].algorithm.policy.kind == "soft_q_learning"
    starts = [case.experiment.algorithm.rollout_start for case in cases if case.group == HARD]
    assert starts == ["demonstration", "initial"]


def test_a_seeded_case_draws_other_demonstrations_and_rollouts() -> None:
    case = all_cases(*shipped())[0]
    one = case.seeded(7)
    assert (one.seed, one.demonstrations.seed) == (7, 7)
    assert replace(case, experiment=one).seeded(1) == case.seeded(1)


def test_an_outcome_is_what_the_simulation_came_to(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_experiment(change=SOFT))
    first, again = (run_case(Case(MAIN, "MA-BIRDS", experiment), 5) for _ in range(2))
    assert [one.learner for one in first] == ["learner_1", "learner_2"]
    for one, other in zip(first, again, strict=True):
        assert replace(one, seconds=[]) == replace(other, seconds=[])
        assert len(one.success_rate) == len(one.violation_rate) == experiment.iterations + 1
        assert (len(one.seconds), one.gradient_steps) == (experiment.iterations, experiment.iterations)
        np.testing.assert_allclose(np.sum(one.visits, axis=1), 1, atol=1e-4)
    assert first[0].success_rate != run_case(Case(MAIN, "MA-BIRDS", experiment), 6)[0].success_rate
    assert shortened(experiment, 2).iterations == 2


def test_the_command_writes_a_report(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    file = make_experiment(change=SOFT)
    options = ("--main", file, "--hard", file, "--seeds", 2, "--iterations", 3, "--jobs", 2, "--out", tmp_path / "out")
    result = mabirds("bench", "discrete", *options, "--json", cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    content = json.loads(result.stdout)
    assert content == json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert content["seeds"] == [301, 302]
    assert {"name", "value", "target", "met"} <= set(content["targets"][0])
    labels = {row["label"] for row in content["results"]}
    assert {
        "MA-BIRDS",
        "BICS",
        "FTL",
        "DLM",
        "ME-greedy",
        "8 learners on an alternating ring",
        "soft Q-learning",
    } <= labels
    with gzip.open(tmp_path / "out" / "outcomes.json.gz", "rt", encoding="utf-8") as stream:
        assert len(json.load(stream)) == 2 * len(content["results"])
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count("<img") == len(list((tmp_path / "out").glob("*.png"))) == 7
    report = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert report.count("\n## ") == 4
    assert "| ME-greedy |" in report


def test_a_group_can_be_run_again(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    file, out = make_experiment(change=SOFT), tmp_path / "out"
    options = ("--main", file, "--hard", file, "--seeds", 1, "--out", out, "--json")
    first = mabirds("bench", "discrete", *options, "--iterations", 2, "--only", "hard", cwd=tmp_path)
    assert {row["group"] for row in json.loads(first.stdout)["results"]} == {"hard"}
    second = mabirds("bench", "discrete", *options, "--iterations", 3, "--only", "main", cwd=tmp_path)
    iterations = {row["group"]: row["iterations"] for row in json.loads(second.stdout)["results"]}
    assert iterations == {"hard": 2, "main": 3}


def test_the_command_refuses_a_missing_experiment(tmp_path: Path) -> None:
    result = mabirds("bench", "discrete", "--main", "nowhere.yaml", cwd=tmp_path)
    assert result.returncode == 2
    assert "nowhere.yaml" in result.stderr
