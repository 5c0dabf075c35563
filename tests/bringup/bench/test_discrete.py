"""The discrete benchmark: its tables worked out by hand, and the command on a small experiment."""

import json
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from mabirds_bringup.bench.cases import Case, truncate
from mabirds_bringup.bench.discrete.cases import AS_WRITTEN, HARD, MAIN, VARIATIONS, all_cases
from mabirds_bringup.bench.discrete.figures import error_curves
from mabirds_bringup.bench.discrete.outcome import run_case
from mabirds_bringup.bench.discrete.report import BENCHMARK, agreement, targets
from mabirds_bringup.bench.frame import LEARNER, array_of, frame_of, read_results
from mabirds_bringup.bench.results import CaseResult, curve, entries
from mabirds_bringup.bench.summary import time_to
from mabirds_bringup.bench.tables import Section
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.metrics.metrics import constraint_errors

MABIRDS = [str(Path(sys.executable).with_name("mabirds"))]
REPOSITORY = Path(__file__).resolve().parents[3]
SOFT = {"algorithm": {"steps": {"alpha": 8.0, "beta": 4.0}, "expectation": "exact"}}


def results(label: str = "MA-BIRDS", learner: str = "learner_1", seed: int = 1, **changes: Any) -> pl.DataFrame:
    """Made up: two updates of 2 s and 3 s."""
    curves = {"violation_rate": [0.9, 0.5, 0.0], "success_rate": [0.0, 0.5, 1.0], "seconds": [2.0, 3.0]}
    numbers = {
        "false_positive_rate": 0.02,
        "false_negative_rate": 0.0,
        "gradient_steps": 2,
        "policy_solves": 4,
        "cost_of_true": [0.1, 0.3],
        "cost_of_harmless": [-1.0, 0.2],
        "learned": [0, 0, 0, 1, 1],
        "visits": [[1.0]],
    }
    rows = [
        row
        for metric, values in curves.items()
        for row in curve(metric, changes.pop(metric, values), first=int(metric == "seconds"))
    ]
    group = changes.pop("group", MAIN)
    return frame_of([CaseResult(group, label, learner, seed, [*rows, *entries(2, **{**numbers, **changes})])])


def table(*made_up: pl.DataFrame) -> Section:
    (section,) = BENCHMARK.sections(BENCHMARK.rows(pl.concat(made_up)))
    return section


@pytest.mark.parametrize(("level", "time"), [(0.5, 2.0), (0.9, 5.0), (0.0, 0.0), (1.1, None)])
def test_the_time_to_a_level_adds_the_updates_before_it(level: float, time: float | None) -> None:
    assert results().group_by(*LEARNER, "seed").agg(found=time_to(level))["found"].to_list() == [time]


def test_a_row_holds_means_over_seeds() -> None:
    other = results(seed=2, violation_rate=[1.0, 1.0, 0.2], seconds=[1.0, 2.0], success_rate=[0.0, 0.6, 0.8])
    (row,) = BENCHMARK.rows(pl.concat([results(), other])).to_dicts()
    assert row["name"] == "MA-BIRDS learner_1"
    assert row["violation_rate"] == pytest.approx({"mean": 0.1, "half_width": 0.1})
    assert row["iteration_seconds"] == pytest.approx(2.0)
    assert row["seconds_to_level"] == [pytest.approx(1.5), None]
    assert (row["iterations"], row["gradient_steps"]) == (2, 2)


def test_times_are_multiples_of_the_fastest_and_work_is_per_iteration() -> None:
    slow = results(
        "FTL", "ftl", seconds=[8.0, 12.0], success_rate=[0.0, 0.0, 0.95], gradient_steps=20, policy_solves=22
    )
    shown = table(results(), slow)
    lines = [dict(zip(shown.columns, line, strict=True)) for line in shown.lines]
    assert [line[""] for line in lines] == ["MA-BIRDS learner_1", "FTL"]
    assert [line["STPOI"] for line in lines] == ["1.000", "4.000"]
    assert [line["50% ST"] for line in lines] == ["1.000", "10.000"]
    assert [line["90% ST"] for line in lines] == ["1.000", "4.000"]
    assert [line["gradient steps"] for line in lines] == ["1.0", "10.0"]
    never = results("DLM", "dlm", success_rate=[0.0, 0.0, 0.0])
    assert table(results(), never).lines[1][6:8] == ["never", "never"]
    assert table(never).lines[0][6:8] == ["never", "never"]


def test_learners_agree_where_their_constraint_sets_are_equal() -> None:
    same, other = results(learner="learner_2"), results(learner="learner_2", learned=[0, 0, 0, 1, 0])
    assert agreement(pl.concat([results(), same])) == {1: True}
    assert agreement(pl.concat([results(), other])) == {1: False}
    assert agreement(pl.concat([results(), same, results("BICS", "bics", learned=[1, 0, 0, 0, 0])])) == {1: True}
    assert agreement(pl.concat([results(), other, results(seed=0)])) == {0: True, 1: False}


def test_targets_say_what_is_met_and_what_is_missed() -> None:
    bad = results(learner="learner_2", false_positive_rate=0.04)
    ftl, dlm = (results(name, name.lower(), seconds=[9.0, 11.0 + extra]) for name, extra in (("FTL", 40), ("DLM", 0)))
    found = dict(targets(pl.concat([results(), bad, ftl, dlm])).select("name", "met").iter_rows())
    assert found["MA-BIRDS learner_1 false_positive_rate"] is True
    assert found["MA-BIRDS learner_2 false_positive_rate"] is False
    assert found["MA-BIRDS learner_2 success_rate"] is True
    assert found["FTL time per iteration / MA-BIRDS"] is True
    assert found["DLM time per iteration / MA-BIRDS"] is False
    assert found["seeds with one constraint set"] is True


def test_targets_of_many_starts_are_those_of_the_experiment_as_it_is_written() -> None:
    first, other = (results(label, group=HARD) for label in (AS_WRITTEN, "rollouts from P_0"))
    found = targets(pl.concat([first, other])).select("name", "met").rows()
    assert found[1:] == [
        ("many starts, learner_1 violation_rate", True),
        ("many starts, learner_1 success_rate", True),
    ]


def test_error_curves_give_the_rates_of_every_threshold() -> None:
    made_up = results(cost_of_true=[0.1, 0.3, 5.0], cost_of_harmless=[-1.0, 0.2])
    mask, omega = np.array([True] * 3 + [False] * 2), -np.array([0.1, 0.3, 5.0, -1.0, 0.2])
    for threshold, false_positive, false_negative in zip(*error_curves(made_up), strict=True):
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
    assert next(case.label for case in cases if case.group == HARD) == AS_WRITTEN


def test_a_seeded_case_draws_other_demonstrations_and_rollouts() -> None:
    case = all_cases(*shipped())[0]
    one = case.seeded(7)
    assert (one.seed, one.demonstrations.seed) == (7, 7)
    assert replace(case, experiment=one).seeded(1) == case.seeded(1)


def test_a_result_is_what_the_simulation_came_to(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_experiment(change=SOFT))
    case = Case(MAIN, "MA-BIRDS", experiment)
    first, again, other = (frame_of(run_case(case, seed)) for seed in (5, 5, 6))
    assert first["learner"].unique(maintain_order=True).to_list() == ["learner_1", "learner_2"]
    assert first.remove(metric="seconds").equals(again.remove(metric="seconds"))
    for learner in experiment.learners:
        own = first.filter(learner=learner, seed=5)
        for metric, iterations in (("success_rate", range(7)), ("violation_rate", range(7)), ("seconds", range(1, 7))):
            assert own.filter(metric=metric)["iteration"].to_list() == list(iterations)
        assert own.filter(metric="gradient_steps")["value"].to_list() == [experiment.iterations]
        np.testing.assert_allclose(array_of(own, "visits").sum(axis=1), 1, atol=1e-4)
    rates, others = (of.filter(metric="success_rate", learner="learner_1")["value"] for of in (first, other))
    assert not rates.equals(others)
    assert truncate(experiment, 2).iterations == 2


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
    written = read_results(tmp_path / "out").select(*LEARNER, "seed").unique()
    assert len(written) == 2 * len(content["results"])
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
