"""The continuous benchmark: its tables and targets worked out by hand, and the command on a small experiment."""

import gzip
import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.continuous.cases import LATTICE, SOFT_ACTOR_CRITIC, VARIATIONS, all_cases
from mabirds_bringup.bench.continuous.outcome import SHOWN_FLIGHTS, Outcome, run_case
from mabirds_bringup.bench.continuous.tables import (
    ACTOR_COLUMNS,
    CLOSING_COLUMNS,
    COLUMNS,
    PILLAR_COLUMNS,
    closing_table,
    dear_pillars,
    pillar_table,
    rows,
    table,
)
from mabirds_bringup.bench.continuous.targets import targets
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.games.drones.study import drone_game

MABIRDS = [str(Path(sys.executable).with_name("mabirds"))]
REPOSITORY = Path(__file__).resolve().parents[3]

MakeExperiment = Callable[..., Path]
QUICK = ("--seeds", 1, "--iterations", 2, "--flights", 40, "--json")


def outcome(label: str = "MA-BIRDS", learner: str = "learner_1", seed: int = 1, **changes: Any) -> Outcome:
    """Made up: two updates of 0.2 s and 0.4 s, and a closing round; two drones, one pillar."""
    values: dict[str, Any] = {
        "group": LATTICE,
        "label": label,
        "learner": learner,
        "seed": seed,
        "violation_rate": [0.9, 0.5, 0.04, 0.01],
        "success_rate": [0.0, 0.5, 0.8, 0.98],
        "actor_violation_rate": [],
        "actor_success_rate": [],
        "seconds": [0.2, 0.4],
        "gradient_steps": 2,
        "policy_solves": 4,
        "peak_memory": 400.0,
        "omega": [-1.0],
        "flights": [[[[0.0, 0.0], [1.0, 1.0]]]],
        "pillar_inside": [[2.0], [1.0]],
        "pillar_rim": [[1.5], [0.5]],
        "flown": [-0.5, 0.2],
        "closeness": [3.0],
        "consensus_theta": [0.0, 2.0, 1.0, 0.1],
        "consensus_omega": [0.0, 4.0, 2.0, 0.2],
        "policy_distance": 0.05,
    }
    return Outcome(**{**values, **changes})


def sac_outcome(**changes: Any) -> Outcome:
    actor = {"actor_violation_rate": [0.8, 0.2], "actor_success_rate": [0.1, 0.7]}
    return outcome(group=SOFT_ACTOR_CRITIC, **{**actor, **changes})


def test_a_row_holds_means_over_seeds_before_and_after_the_closing_rounds() -> None:
    other = outcome(seed=2, violation_rate=[1.0, 1.0, 0.08, 0.03], seconds=[0.3, 0.3], peak_memory=500.0)
    (row,) = rows([outcome(), other])
    assert (row.violation_rate.mean, row.violation_rate.half_width) == pytest.approx((0.02, 0.01))
    assert (row.updated_violation_rate.mean, row.updated_success_rate.mean) == pytest.approx((0.06, 0.8))
    assert row.success_rate.mean == pytest.approx(0.98)
    assert row.iteration_seconds == pytest.approx(0.3)
    assert row.seconds_to_level == (pytest.approx(0.25), pytest.approx(0.6))
    assert (row.iterations, row.gradient_steps, row.policy_solves, row.peak_memory) == (2, 2, 4, 450)
    assert (row.consensus_theta.mean, row.consensus_omega.mean) == pytest.approx((0.1, 0.2))
    assert row.actor_success_rate is None


def test_the_actors_rates_are_those_of_the_last_policy_found() -> None:
    (row,) = rows([sac_outcome(), sac_outcome(seed=2, actor_success_rate=[0.0, 0.9])])
    assert row.actor_violation_rate.mean == pytest.approx(0.2)
    assert (row.actor_success_rate.mean, row.actor_success_rate.half_width) == pytest.approx((0.8, 0.1))


def test_times_are_multiples_of_the_fastest_and_work_is_per_iteration() -> None:
    slow = outcome("FTL", "ftl", seconds=[2.0, 4.0], success_rate=[0.0, 0.4, 0.95], gradient_steps=20, policy_solves=22)
    columns, lines = table(rows([outcome(), slow]))
    assert columns == COLUMNS
    first, second = (dict(zip(columns, line, strict=True)) for line in lines)
    assert (first[""], second[""]) == ("MA-BIRDS learner_1", "FTL")
    assert (first["CVR"], first["SR"]) == ("0.010 ± 0.000", "0.980 ± 0.000")
    assert (first["STPOI"], second["STPOI"]) == ("1.000", "10.000")
    assert (first["50% ST"], second["50% ST"]) == ("1.000", "30.000")  # 0.2 s, 6 s
    assert (first["90% ST"], second["90% ST"]) == ("1.000", "10.000")
    assert (second["gradient steps"], second["policy solves"], second["seconds"]) == ("10.0", "11.0", "3.000")
    assert first["memory [MB]"] == "400"


def test_soft_actor_critics_have_columns_of_their_actors() -> None:
    columns, (line, without) = table(rows([sac_outcome(), outcome("BICS", "bics")]))
    assert columns == ACTOR_COLUMNS
    assert without[3:5] == ["", ""]
    assert len(without) == len(line) == len(columns)
    found = dict(zip(columns, line, strict=True))
    assert (found["SR"], found["actor's CVR"], found["actor's SR"]) == tuple(
        f"{rate:.3f} ± 0.000" for rate in (0.98, 0.2, 0.7)
    )


def test_the_closing_table_is_of_learners_alone() -> None:
    (line,) = closing_table(rows([outcome(), outcome("BICS", "bics")]))
    found = dict(zip(CLOSING_COLUMNS, line, strict=True))
    assert (found["SR, last update"], found["SR, end"]) == ("0.800 ± 0.000", "0.980 ± 0.000")
    assert (found["distance of theta"], found["of omega"], found["of flights"]) == (
        "1.0e-01",
        "2.0e-01",
        "0.050 ± 0.000",
    )


def test_a_pillar_is_dear_where_it_and_its_rim_cost_more_than_ways_flown() -> None:
    assert dear_pillars(outcome()) == {(0, 0): True, (1, 0): True}
    assert dear_pillars(outcome(pillar_rim=[[1.5], [0.1]])) == {(0, 0): True, (1, 0): False}
    assert dear_pillars(outcome(pillar_inside=[[-0.5], [1.0]])) == {(0, 0): False, (1, 0): True}
    assert dear_pillars(outcome(pillar_inside=[[], []], pillar_rim=[[], []])) == {}
    (row,) = rows([outcome(), outcome(seed=2, pillar_rim=[[1.5], [0.1]], closeness=[-1.0])])
    assert (row.dear_pillars, row.dear_closeness) == (0.75, 0.5)


def test_the_table_of_pillars_counts_learners_and_seeds(make_drone_experiment: MakeExperiment) -> None:
    settings = drone_game(load_experiment(make_drone_experiment())).settings
    cheap = outcome(seed=2, pillar_inside=[[1.0], [1.0]], pillar_rim=[[-0.6], [0.5]])
    lines = pillar_table(settings, [outcome(), cheap, outcome("BICS", "bics")])
    first, second = (dict(zip(PILLAR_COLUMNS, line, strict=True)) for line in lines)
    assert (first["pillar"], first["drone"], second["drone"]) == ("(1.5, 1.5) m", "1", "2")
    assert (first["touching it"], first["its rim"]) == ("1.500 ± 0.500", "0.450 ± 1.050")
    assert (first["dearer"], second["dearer"]) == ("1 of 2", "2 of 2")


def test_targets_say_what_is_met_and_what_is_missed() -> None:
    bad = outcome(learner="learner_2", violation_rate=[1, 1, 0.0, 0.03], pillar_rim=[[1.5], [0.1]], seconds=[0.6, 0.6])
    ftl, dlm = (outcome(name, name.lower(), seconds=[t, t]) for name, t in (("FTL", 1.4), ("DLM", 1.6)))
    bics = outcome("BICS", "bics", success_rate=[0, 0, 0, 0.96])
    found = {one.name: one.met for one in targets([outcome(), bad, bics, ftl, dlm])}
    assert found["MA-BIRDS learner_1 violation_rate"] is True
    assert found["MA-BIRDS learner_2 violation_rate"] is False
    assert found["BICS success_rate"] is True
    assert found["MA-BIRDS learner_1 seconds an iteration"] is True
    assert found["MA-BIRDS learner_2 seconds an iteration"] is False
    assert found["FTL time an iteration / MA-BIRDS"] is False  # 1.4 s / 0.3 s
    assert found["DLM time an iteration / MA-BIRDS"] is True
    assert found["MA-BIRDS learner_1 share of pillars that cost more than ways flown"] is True
    assert found["MA-BIRDS learner_2 share of pillars that cost more than ways flown"] is False
    assert found["MA-BIRDS learner_2 share of seeds where closeness costs"] is True


def test_targets_of_soft_actor_critics_are_those_of_parameters_and_of_actors() -> None:
    found = {one.name: one.met for one in targets([sac_outcome(seconds=[2.0, 2.0])])}
    assert found["soft actor-critic, MA-BIRDS learner_1 success_rate"] is True
    assert found["soft actor-critic, MA-BIRDS learner_1 actor's success_rate"] is False
    assert found["soft actor-critic, MA-BIRDS learner_1 seconds an iteration"] is True
    assert len(found) == 7


def test_variations_have_no_targets() -> None:
    assert targets([outcome("neural reward", group=VARIATIONS)]) == []


def shipped() -> Experiment:
    return load_experiment(REPOSITORY / "ros_ws" / "config" / "drones.yaml")


def test_the_cases_are_all_methods_by_either_finder_and_variations() -> None:
    main = shipped()
    by_group: dict[str, dict[str, Case]] = {}
    for case in all_cases(main, main):
        by_group.setdefault(case.group, {})[case.label] = case
    assert list(by_group[LATTICE]) == ["MA-BIRDS", "BICS", "FTL", "DLM", "ME-gradient"]
    assert [case.method for case in by_group[LATTICE].values()] == [None, "bics", "ftl", "dlm", "me_gradient"]
    assert list(by_group[SOFT_ACTOR_CRITIC]) == ["MA-BIRDS", "BICS"]
    variations = by_group[VARIATIONS]
    assert variations["sides at random"].experiment.demonstrations.side == "random"
    assert variations["all pass on the right"].experiment.demonstrations.side == "right"
    assert variations["neural reward"].experiment.algorithm.reward.kind == "neural"
    assert variations["BICS by soft actor-critic, sides by start"].method == "bics"
    assert {case.group for case in all_cases(main, None)} == {LATTICE, VARIATIONS}


def test_an_outcome_is_what_the_simulation_came_to(make_drone_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_drone_experiment(iterations=3)).model_copy(update={"closing_rounds": 2})
    first, again = (run_case(Case(LATTICE, "MA-BIRDS", experiment), 5, 40) for _ in range(2))
    assert [one.learner for one in first] == ["learner_1", "learner_2"]
    game = drone_game(experiment)
    for one, other in zip(first, again, strict=True):
        assert replace(one, seconds=[], peak_memory=0) == replace(other, seconds=[], peak_memory=0)
        assert len(one.success_rate) == len(one.violation_rate) == len(one.consensus_omega) == 3 + 2 + 1
        assert (len(one.seconds), one.gradient_steps, one.actor_success_rate) == (3, 3, [])
        assert np.shape(one.flights) == (SHOWN_FLIGHTS, game.horizon + 1, 2, 2)
        assert np.shape(one.pillar_inside) == (2, 1)
        assert len(one.omega) == len(game.cost_features.names)
        # A full graph of two agrees at once, up to rounding, and equal parameters fly alike.
        assert one.consensus_theta[2] > one.consensus_theta[-1] == pytest.approx(0, abs=1e-9)
        assert one.policy_distance == pytest.approx(0, abs=1e-3)
    assert first[0].omega != run_case(Case(LATTICE, "MA-BIRDS", experiment), 6, 40)[0].omega


def test_actors_are_judged_at_every_update(make_drone_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_drone_experiment("soft_actor_critic", iterations=2))
    for case in (Case(SOFT_ACTOR_CRITIC, "MA-BIRDS", experiment), Case(SOFT_ACTOR_CRITIC, "BICS", experiment, "bics")):
        for one in run_case(case, 5, 40):
            assert len(one.actor_success_rate) == len(one.actor_violation_rate) == 2
            assert len(one.success_rate) == 3


def test_peak_memory_is_that_of_the_process() -> None:
    program = (
        "from mabirds_bringup.bench.continuous.outcome import peak_memory\nimport numpy as np\nbefore = peak_memory()\n"
        "grown = np.ones(20_000_000)\ndel grown\nprint(peak_memory() - before)"
    )
    grown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert float(grown.stdout) == pytest.approx(160, abs=15)


def mabirds(*arguments: object, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [*MABIRDS, *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False)


@pytest.fixture
def files(make_drone_experiment: MakeExperiment) -> tuple[Path, Path]:
    """The experiment, and the same by soft actor-critic beside it."""
    quick = {"baselines": {"ftl": {"most_steps": 2}, "dlm": {"most_steps": 2}}}
    main, sac = (make_drone_experiment(finder, name=finder) for finder in ("lattice", "soft_actor_critic"))
    main.write_text(main.read_text(encoding="utf-8") + json.dumps(quick)[1:-1] + "\n", encoding="utf-8")
    return main, Path(shutil.copy(sac, main.with_name("experiment_sac.yaml")))


def test_the_command_writes_a_report(files: tuple[Path, Path], tmp_path: Path) -> None:
    out = tmp_path / "out"
    result = mabirds("bench", "continuous", "--main", files[0], *QUICK, "--jobs", 2, "--out", out, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    content = json.loads(result.stdout)
    assert content == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert content["seeds"] == [301]
    assert content["flights"] == 40
    assert {"cores", "threads", "python", "numpy", "scipy", "torch"} == set(content["machine"])
    groups = {(row["group"], row["label"]) for row in content["results"]}
    assert {(LATTICE, "ME-gradient"), (SOFT_ACTOR_CRITIC, "BICS"), (VARIATIONS, "neural reward")} <= groups
    assert all(row["iterations"] == 2 and row["peak_memory"] > 50 for row in content["results"])
    with gzip.open(out / "outcomes.json.gz", "rt", encoding="utf-8") as stream:
        assert len(json.load(stream)) == len(content["results"])
    page = (out / "report.html").read_text(encoding="utf-8")
    pictures = {path.name for path in out.glob("*.png")}
    assert {"game.png", "cost.png", "rates.png", "consensus.png", "cost_soft_actor_critic.png"} <= pictures
    assert page.count("<img") == len(pictures) == 9
    report = (out / "report.md").read_text(encoding="utf-8")
    assert report.count("\n## ") == 7
    assert "| ME-gradient |" in report


def test_a_group_can_be_run_again(files: tuple[Path, Path], tmp_path: Path) -> None:
    (tmp_path / "sac").mkdir()
    elsewhere = Path(shutil.copy(files[1], tmp_path / "sac" / "networks.yaml"))
    files[1].unlink()
    options = ("--main", files[0], *QUICK, "--out", tmp_path / "out")
    refused = mabirds("bench", "continuous", *options, "--only", "soft_actor_critic", cwd=tmp_path)
    assert refused.returncode == 2
    assert "experiment_sac.yaml" in refused.stderr.replace("\n", "")
    only = ("--sac", elsewhere, "--only", "soft_actor_critic")
    first = mabirds("bench", "continuous", *options, *only, cwd=tmp_path)
    assert {row["group"] for row in json.loads(first.stdout)["results"]} == {SOFT_ACTOR_CRITIC}
    second = mabirds("bench", "continuous", *options, "--only", "variations", cwd=tmp_path)
    assert {row["group"] for row in json.loads(second.stdout)["results"]} == {SOFT_ACTOR_CRITIC, VARIATIONS}


def test_the_command_refuses_a_game_without_drones(make_experiment: MakeExperiment, tmp_path: Path) -> None:
    result = mabirds("bench", "continuous", "--main", make_experiment(), "--only", "lattice", cwd=tmp_path)
    assert result.returncode == 2
    assert "the game is patrol, expected drones" in result.stderr
