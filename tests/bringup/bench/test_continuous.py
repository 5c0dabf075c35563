"""The continuous benchmark: its tables and targets worked out by hand, and the command on a small experiment."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.continuous.cases import LATTICE, SOFT_ACTOR_CRITIC, VARIATIONS, all_cases
from mabirds_bringup.bench.continuous.outcome import SHOWN_FLIGHTS, dear_pillars, run_case
from mabirds_bringup.bench.continuous.report import BENCHMARK, closing_section, pillar_section
from mabirds_core.games.drones.study import drone_game

from mabirds_bringup.bench.frame import LEARNER, array_of, frame_of, read_results, write_results
from mabirds_bringup.bench.results import CaseResult, curve, entries
from mabirds_bringup.bench.tables import Section
from mabirds_core.experiment.file import Experiment, load_experiment

MABIRDS = [str(Path(sys.executable).with_name("mabirds"))]
REPOSITORY = Path(__file__).resolve().parents[3]

MakeExperiment = Callable[..., Path]
QUICK = ("--seeds", 1, "--iterations", 2, "--flights", 40, "--json")


CURVES = {
    "violation_rate": [0.9, 0.5, 0.04, 0.01],
    "success_rate": [0.0, 0.5, 0.8, 0.98],
    "actor_violation_rate": [],
    "actor_success_rate": [],
    "seconds": [0.2, 0.4],
    "consensus_theta": [0.0, 2.0, 1.0, 0.1],
    "consensus_omega": [0.0, 4.0, 2.0, 0.2],
}
NUMBERS = {
    "gradient_steps": 2,
    "policy_solves": 4,
    "peak_memory": 400.0,
    "pillar_inside": [[2.0], [1.0]],
    "pillar_rim": [[1.5], [0.5]],
    "flown": [-0.5, 0.2],
    "closeness": [3.0],
    "policy_distance": 0.05,
}


def results(label: str = "MA-BIRDS", learner: str = "learner_1", seed: int = 1, **changes: Any) -> pl.DataFrame:
    """Made up: two updates of 0.2 s and 0.4 s, and a closing round; two drones, one pillar."""
    group = changes.pop("group", LATTICE)
    curves = {metric: changes.pop(metric, values) for metric, values in CURVES.items()}
    numbers = {metric: np.array(values) for metric, values in {**NUMBERS, **changes}.items()}
    rows = [row for metric, values in curves.items() for row in curve(metric, values, first=int(metric == "seconds"))]
    rows += entries(3, **numbers, pillar_dearer=dear_pillars(numbers))
    return frame_of([CaseResult(group, label, learner, seed, rows)])


def sac_results(**changes: Any) -> pl.DataFrame:
    actor = {"actor_violation_rate": [0.8, 0.2], "actor_success_rate": [0.1, 0.7]}
    return results(group=SOFT_ACTOR_CRITIC, **{**actor, **changes})


def rows(*made_up: pl.DataFrame) -> pl.DataFrame:
    return BENCHMARK.rows(pl.concat(made_up))


def targets(*made_up: pl.DataFrame) -> dict[str, bool]:
    return dict(BENCHMARK.targets(rows(*made_up)).select("name", "met").iter_rows())


def lines_of(section: Section) -> list[dict[str, str]]:
    return [dict(zip(section.columns, line, strict=True)) for line in section.lines]


def test_a_row_holds_means_over_seeds_before_and_after_the_closing_rounds() -> None:
    other = results(seed=2, violation_rate=[1.0, 1.0, 0.08, 0.03], seconds=[0.3, 0.3], peak_memory=500.0)
    (row,) = rows(results(), other).to_dicts()
    assert row["violation_rate"] == pytest.approx({"mean": 0.02, "half_width": 0.01})
    assert (row["updated_violation_rate"]["mean"], row["updated_success_rate"]["mean"]) == pytest.approx((0.06, 0.8))
    assert row["success_rate"]["mean"] == pytest.approx(0.98)
    assert row["iteration_seconds"] == pytest.approx(0.3)
    assert row["seconds_to_level"] == pytest.approx([0.25, 0.6])
    assert [row[of] for of in ("iterations", "gradient_steps", "policy_solves", "peak_memory")] == [2, 2, 4, 450]
    assert (row["consensus_theta"]["mean"], row["consensus_omega"]["mean"]) == pytest.approx((0.1, 0.2))
    assert row["actor_success_rate"] is None


def test_the_actors_rates_are_those_of_the_last_policy_found() -> None:
    (row,) = rows(sac_results(), sac_results(seed=2, actor_success_rate=[0.0, 0.9])).to_dicts()
    assert row["actor_violation_rate"]["mean"] == pytest.approx(0.2)
    assert row["actor_success_rate"] == pytest.approx({"mean": 0.8, "half_width": 0.1})


def test_times_are_multiples_of_the_fastest_and_work_is_per_iteration() -> None:
    slow = results("FTL", "ftl", seconds=[2.0, 4.0], success_rate=[0.0, 0.4, 0.95], gradient_steps=20, policy_solves=22)
    (table,) = BENCHMARK.sections(rows(results(), slow))
    assert "actor's SR" not in table.columns
    first, second = lines_of(table)
    assert (first[""], second[""]) == ("MA-BIRDS learner_1", "FTL")
    assert (first["CVR"], first["SR"]) == ("0.010 ± 0.000", "0.980 ± 0.000")
    assert (first["STPOI"], second["STPOI"]) == ("1.000", "10.000")
    assert (first["50% ST"], second["50% ST"]) == ("1.000", "30.000")  # 0.2 s, 6 s
    assert (first["90% ST"], second["90% ST"]) == ("1.000", "10.000")
    assert (second["gradient steps"], second["policy solves"], second["seconds"]) == ("10.0", "11.0", "3.000")
    assert first["memory [MB]"] == "400"


def test_soft_actor_critics_have_columns_of_their_actors() -> None:
    (table,) = BENCHMARK.sections(rows(sac_results(), results("BICS", "bics", group=SOFT_ACTOR_CRITIC)))
    assert list(table.columns[3:5]) == ["actor's CVR", "actor's SR"]
    found, without = lines_of(table)
    assert (without["actor's CVR"], without["actor's SR"]) == ("", "")
    assert (found["SR"], found["actor's CVR"], found["actor's SR"]) == tuple(
        f"{rate:.3f} ± 0.000" for rate in (0.98, 0.2, 0.7)
    )


def test_the_closing_table_is_of_learners_alone() -> None:
    (found,) = lines_of(closing_section(rows(results(), results("BICS", "bics"))))
    assert found[""] == "MA-BIRDS learner_1 (lattice)"
    assert (found["SR, last update"], found["SR, end"]) == ("0.800 ± 0.000", "0.980 ± 0.000")
    assert (found["distance of theta"], found["of omega"], found["of flights"]) == (
        "1.0e-01",
        "2.0e-01",
        "0.050 ± 0.000",
    )


def dear(**changes: Any) -> list[list[bool]]:
    return dear_pillars({metric: np.array(values) for metric, values in {**NUMBERS, **changes}.items()}).tolist()


def test_a_pillar_is_dear_where_it_and_its_rim_cost_more_than_ways_flown() -> None:
    assert dear() == [[True], [True]]
    assert dear(pillar_rim=[[1.5], [0.1]]) == [[True], [False]]
    assert dear(pillar_inside=[[-0.5], [1.0]]) == [[False], [True]]
    assert dear(pillar_inside=[[], []], pillar_rim=[[], []]) == [[], []]
    (row,) = rows(results(), results(seed=2, pillar_rim=[[1.5], [0.1]], closeness=[-1.0])).to_dicts()
    assert (row["dear_pillars"], row["dear_closeness"]) == (0.75, 0.5)


def test_without_pillars_and_pairs_none_is_too_cheap() -> None:
    (row,) = rows(results(pillar_inside=[[], []], pillar_rim=[[], []], closeness=[])).to_dicts()
    assert (row["dear_pillars"], row["dear_closeness"]) == (1.0, None)


def test_the_table_of_pillars_counts_learners_and_seeds(make_drone_experiment: MakeExperiment) -> None:
    settings = drone_game(load_experiment(make_drone_experiment())).settings
    cheap = results(seed=2, pillar_inside=[[1.0], [1.0]], pillar_rim=[[-0.6], [0.5]])
    made_up = pl.concat([results(), cheap, results("BICS", "bics"), results(group=VARIATIONS)])
    first, second = lines_of(pillar_section(settings, made_up, LATTICE))
    assert (first["pillar"], first["drone"], second["drone"]) == ("(1.5, 1.5) m", "1", "2")
    assert (first["touching it"], first["its rim"]) == ("1.500 ± 0.500", "0.450 ± 1.050")
    assert (first["ways flown"], second["ways flown"]) == ("-0.500 ± 0.000", "0.200 ± 0.000")
    assert (first["dearer"], second["dearer"]) == ("1 of 2", "2 of 2")


def test_targets_say_what_is_met_and_what_is_missed() -> None:
    bad = results(learner="learner_2", violation_rate=[1, 1, 0.0, 0.03], pillar_rim=[[1.5], [0.1]], seconds=[0.6, 0.6])
    ftl, dlm = (results(name, name.lower(), seconds=[t, t]) for name, t in (("FTL", 1.4), ("DLM", 1.6)))
    bics = results("BICS", "bics", success_rate=[0, 0, 0, 0.96])
    found = targets(results(), bad, bics, ftl, dlm)
    assert found["MA-BIRDS learner_1 violation_rate"] is True
    assert found["MA-BIRDS learner_2 violation_rate"] is False
    assert found["BICS success_rate"] is True
    assert found["MA-BIRDS learner_1 seconds per iteration"] is True
    assert found["MA-BIRDS learner_2 seconds per iteration"] is False
    assert found["FTL time per iteration / MA-BIRDS"] is False  # 1.4 s / 0.3 s
    assert found["DLM time per iteration / MA-BIRDS"] is True
    assert found["MA-BIRDS learner_1 share of pillars that cost more than ways flown"] is True
    assert found["MA-BIRDS learner_2 share of pillars that cost more than ways flown"] is False
    assert found["MA-BIRDS learner_2 share of seeds where closeness costs"] is True


def test_targets_of_soft_actor_critics_are_those_of_parameters_and_of_actors() -> None:
    found = targets(sac_results(seconds=[2.0, 2.0]))
    assert found["soft actor-critic, MA-BIRDS learner_1 success_rate"] is True
    assert found["soft actor-critic, MA-BIRDS learner_1 actor's success_rate"] is False
    assert found["soft actor-critic, MA-BIRDS learner_1 seconds per iteration"] is True
    assert len(found) == 7


def test_variations_have_no_targets() -> None:
    assert targets(results("neural reward", group=VARIATIONS)) == {}


def shipped() -> Experiment:
    return load_experiment(REPOSITORY / "ros_ws" / "config" / "drones.yaml")


def test_the_cases_are_all_methods_by_either_planner_and_variations() -> None:
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


def at(results: pl.DataFrame, metric: str) -> list[float]:
    return results.filter(metric=metric).sort("iteration")["value"].to_list()


def test_a_result_is_what_the_simulation_came_to(make_drone_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_drone_experiment(iterations=3)).model_copy(update={"closing_rounds": 2})
    case = Case(LATTICE, "MA-BIRDS", experiment)
    first, again, other = (frame_of(run_case(case, seed, 40)) for seed in (5, 5, 6))
    measured = pl.col("metric").is_in(["seconds", "peak_memory"])
    assert first.remove(measured).equals(again.remove(measured))
    assert first["learner"].unique(maintain_order=True).to_list() == ["learner_1", "learner_2"]
    game = drone_game(experiment)
    for learner in experiment.learners:
        own = first.filter(learner=learner, seed=5)
        for metric in ("success_rate", "violation_rate", "consensus_omega"):
            assert len(at(own, metric)) == 3 + 2 + 1
        assert own.filter(metric="seconds")["iteration"].to_list() == [1, 2, 3]
        assert (at(own, "gradient_steps"), at(own, "actor_success_rate")) == ([3], [])
        assert array_of(own, "flights").shape == (SHOWN_FLIGHTS, game.horizon + 1, 2, 2)
        assert array_of(own, "pillar_inside").shape == array_of(own, "pillar_dearer").shape == (2, 1)
        assert array_of(own, "omega").shape == (len(game.cost_features.names),)
        # A full graph of two agrees at once, up to rounding, and equal parameters fly alike.
        theta = at(own, "consensus_theta")
        assert theta[2] > theta[-1] == pytest.approx(0, abs=1e-9)
        assert at(own, "policy_distance") == pytest.approx([0], abs=1e-3)
    omega, others = (array_of(of.filter(learner="learner_1"), "omega") for of in (first, other))
    assert not np.array_equal(omega, others)


def test_actors_are_judged_at_every_update(make_drone_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_drone_experiment("soft_actor_critic", iterations=2))
    for case in (Case(SOFT_ACTOR_CRITIC, "MA-BIRDS", experiment), Case(SOFT_ACTOR_CRITIC, "BICS", experiment, "bics")):
        for result in run_case(case, 5, 40):
            own = frame_of([result])
            assert len(at(own, "actor_success_rate")) == len(at(own, "actor_violation_rate")) == 2
            assert len(at(own, "success_rate")) == 3


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


@pytest.fixture(scope="module")
def files(make_shared_drone_experiment: MakeExperiment) -> tuple[Path, Path]:
    """The experiment, and the same by soft actor-critic beside it."""
    quick = {"baselines": {"ftl": {"max_steps": 2}, "dlm": {"max_steps": 2}}}
    main, sac = (make_shared_drone_experiment(planner, name=planner) for planner in ("lattice", "soft_actor_critic"))
    main.write_text(main.read_text(encoding="utf-8") + json.dumps(quick)[1:-1] + "\n", encoding="utf-8")
    return main, Path(shutil.copy(sac, main.with_name("experiment_sac.yaml")))


@pytest.fixture(scope="module")
def report(files: tuple[Path, Path], tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The directory of a report on everything, and what the command said."""
    out = tmp_path_factory.mktemp("report") / "out"
    result = mabirds("bench", "continuous", "--main", files[0], *QUICK, "--jobs", 2, "--out", out, cwd=out.parent)
    assert result.returncode == 0, result.stderr
    return out, json.loads(result.stdout)


def test_the_command_writes_a_report(report: tuple[Path, dict[str, Any]]) -> None:
    out, content = report
    assert content == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert content["seeds"] == [301]
    assert content["flights"] == 40
    assert {"cores", "threads", "python", "numpy", "scipy", "torch"} == set(content["machine"])
    groups = {(row["group"], row["label"]) for row in content["results"]}
    assert {(LATTICE, "ME-gradient"), (SOFT_ACTOR_CRITIC, "BICS"), (VARIATIONS, "neural reward")} <= groups
    assert all(row["iterations"] == 2 and row["peak_memory"] > 50 for row in content["results"])
    assert len(read_results(out).select(*LEARNER, "seed").unique()) == len(content["results"])
    page = (out / "report.html").read_text(encoding="utf-8")
    pictures = {path.name for path in out.glob("*.png")}
    assert {"game.png", "cost.png", "rates.png", "consensus.png", "cost_soft_actor_critic.png"} <= pictures
    assert page.count("<img") == len(pictures) == 9
    report = (out / "report.md").read_text(encoding="utf-8")
    assert report.count("\n## ") == 7
    assert "| ME-gradient |" in report


def test_a_group_can_be_run_again(
    files: tuple[Path, Path], report: tuple[Path, dict[str, Any]], tmp_path: Path
) -> None:
    """It alone is run, and what there is of the others stays."""
    out = Path(shutil.copytree(report[0], tmp_path / "out"))
    write_results(out, read_results(out).filter(pl.col("group") != VARIATIONS))
    main, elsewhere = Path(shutil.copy(files[0], tmp_path)), Path(shutil.copy(files[1], tmp_path / "networks.yaml"))
    options = ("--main", main, *QUICK, "--iterations", 1, "--out", out, "--only", "soft_actor_critic")
    refused = mabirds("bench", "continuous", *options, cwd=tmp_path)
    assert refused.returncode == 2
    assert "experiment_sac.yaml" in refused.stderr.replace("\n", "")
    again = mabirds("bench", "continuous", *options, "--sac", elsewhere, "--jobs", 2, cwd=tmp_path)
    iterations = {(row["group"], row["iterations"]) for row in json.loads(again.stdout)["results"]}
    assert iterations == {(LATTICE, 2), (SOFT_ACTOR_CRITIC, 1)}


def test_the_command_refuses_a_game_without_drones(make_experiment: MakeExperiment, tmp_path: Path) -> None:
    result = mabirds("bench", "continuous", "--main", make_experiment(), "--only", "lattice", cwd=tmp_path)
    assert result.returncode == 2
    assert "the game is patrol, expected drones" in result.stderr
