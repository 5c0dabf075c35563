"""Study files: what they declare, what is refused, and the two of the package."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from mabirds_bringup.bench.study import Case, LoadedStudy, load_study, merged, packaged_studies
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game

MakeExperiment = Callable[..., Path]
MakeStudy = Callable[..., Path]

CASES = [{"label": "MA-BIRDS"}, {"label": "BICS", "method": "bics"}]
CONTENT: dict[str, Any] = {
    "title": "{main.name}, {main.iterations} iterations",
    "note": "{rollouts} rollouts, else {fewer}.",
    "experiments": {"main": "experiment/experiment.yaml"},
    "groups": {"main": {"title": "All", "cases": CASES}},
    "columns": {"SR": "success_rate"},
}


@pytest.fixture
def make_study(make_experiment: MakeExperiment, tmp_path: Path) -> MakeStudy:
    make_experiment()

    def make(**changes: Any) -> Path:
        file = tmp_path / "study.yaml"
        file.write_text(yaml.safe_dump({**CONTENT, **changes}), encoding="utf-8")
        return file

    return make


def test_cases_are_what_the_file_says(make_study: MakeStudy) -> None:
    changes = {"algorithm": {"rollouts": 7}, "schedule": {"kind": "alternating"}}
    cases = [*CASES, {"label": "few rollouts", "changes": changes}]
    file = make_study(groups={"main": {"title": "All", "cases": cases, "own_policies": True}}, rollouts=40)
    study = load_study(str(file), iterations=4)
    assert [(case.group, case.label, case.method) for case in study.cases] == [
        ("main", "MA-BIRDS", None),
        ("main", "BICS", "bics"),
        ("main", "few rollouts", None),
    ]
    assert {(case.own_policies, case.rollouts, case.experiment.iterations) for case in study.cases} == {(True, 40, 4)}
    before, after = study.cases[0].experiment, study.cases[2].experiment
    assert (after.algorithm.rollouts, after.schedule.kind) == (7, "alternating")
    assert after.algorithm.steps == before.algorithm.steps
    assert (study.title, study.note) == ("small, 4 iterations", "40 rollouts, else 4.")


def test_experiments_and_rollouts_can_be_replaced(make_study: MakeStudy, make_experiment: MakeExperiment) -> None:
    other = make_experiment(iterations=3, name="other")
    study = load_study(str(make_study()), {"main": other}, rollouts=60)
    assert study.experiments["main"].iterations == 3
    assert study.cases[0].rollouts == 60


def test_a_mapping_with_a_kind_takes_the_old_ones_place() -> None:
    before = {"reward": {"kind": "linear", "scale": 2}, "steps": {"kind": "paper", "alpha": 1, "beta": 2}}
    after = merged(before, {"reward": {"kind": "neural"}, "steps": {"alpha": 3}})
    assert after == {"reward": {"kind": "neural"}, "steps": {"kind": "paper", "alpha": 3, "beta": 2}}
    assert merged({"learners": [1, 2]}, {"learners": [3]}) == {"learners": [3]}


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"mispelt": 1}, "mispelt"),
        ({"rollouts": "40"}, "rollouts"),
        ({"groups": {"Main group": CONTENT["groups"]["main"]}}, "groups"),
        ({"groups": {"main": {"title": "All", "cases": [CASES[0], CASES[0]]}}}, "two cases of a group have one label"),
        (
            {"groups": {"main": {"title": "All", "cases": [{"experiment": "hard"}]}}},
            "experiment 'hard': expected one of",
        ),
        ({"groups": {"main": {"title": "All", "cases": [{"method": "bcis"}]}}}, "method 'bcis': expected one of"),
        ({"targets": [{"measure": "success_rate", "groups": ["hard"]}]}, "group 'hard': expected one of"),
        ({"tables": [{"title": "", "group": "hard", "columns": {}}]}, "group 'hard': expected one of"),
        ({"title": "{hard.name}"}, "title and note may name"),
    ],
)
def test_what_is_wrong_is_said_before_anything_is_learned(make_study: MakeStudy, changes: Any, words: str) -> None:
    file = make_study(**changes)
    with pytest.raises(ExperimentError, match=words) as refusal:
        load_study(str(file))
    assert str(file) in str(refusal.value)


def test_a_case_whose_changes_are_wrong_is_named(make_study: MakeStudy) -> None:
    wrong = [{"label": "odd", "changes": {"algorithm": {"rolouts": 7}}}]
    with pytest.raises(ExperimentError, match="main, odd: .*rolouts"):
        _ = load_study(str(make_study(groups={"main": {"title": "All", "cases": wrong}}))).cases


def test_studies_that_are_not_there_are_refused(make_study: MakeStudy, tmp_path: Path) -> None:
    with pytest.raises(ExperimentError, match="give a study's file, or one of continuous, costs, discrete"):
        load_study("discreet")
    with pytest.raises(ExperimentError, match="experiment 'hard': expected one of"):
        load_study(str(make_study()), {"hard": tmp_path / "experiment.yaml"})
    (tmp_path / "no.yaml").write_text("{", encoding="utf-8")
    with pytest.raises(ExperimentError, match=r"no\.yaml: is not YAML"):
        load_study(str(tmp_path / "no.yaml"))


def by_label(study: LoadedStudy, group: str) -> dict[str, Case]:
    return {case.label: case for case in study.cases if case.group == group}


def test_the_packages_studies_are_read() -> None:
    assert packaged_studies() == ("continuous", "costs", "discrete")


def test_the_discrete_study_has_all_methods_and_all_variations() -> None:
    study = load_study("discrete")
    assert [case.method for case in by_label(study, "main").values()] == [None, "bics", "ftl", "dlm", "me_greedy"]
    variations = {label: case.experiment for label, case in by_label(study, "variations").items()}
    for count in (2, 4, 8):
        ring = variations[f"{count} learners on an alternating ring"]
        assert (len(ring.learners), ring.schedule.kind, ring.closing_rounds) == (count, "alternating", 2 * count)
    assert variations["sampled expectations"].algorithm.expectation == "sampled"
    assert variations["neural reward"].algorithm.reward.kind == "neural"
    assert variations["soft Q-learning"].algorithm.policy.kind == "soft_q_learning"
    starts = [case.experiment.algorithm.rollout_start for case in by_label(study, "many_starts").values()]
    optimal = by_label(study, "optimal").values()
    assert {case.experiment.demonstrations.experts for case in optimal} == {"optimal"}
    tolerances = [case.experiment.baselines.ftl.tolerance for case in by_label(study, "tolerances").values()]
    assert tolerances[2:7] == [2.0, 1.0, 0.5, 0.2, 0.1]
    assert starts == ["demonstration", "initial"]
    for name in ("main", "many_starts"):  # the paper's game has 77
        assert build_game(study.experiments[name]).true_constraints.sum() >= 77
    assert build_game(study.experiments["trio"]).n_experts == 3


def test_the_study_of_costs_compares_networks_with_weights_of_features() -> None:
    study = load_study("costs")
    for group in ("patrol", "discrete", "hall"):
        plain, *networks = (case.experiment.algorithm.cost for case in by_label(study, group).values())
        assert plain.kind == "linear"
        expected = [(1.0, False), (1.0, True), (0.0, False)]
        assert [(of.apart, of.beside_features) for of in networks] == expected
    told = by_label(study, "distance")["weights of features, told"].experiment
    assert (told.algorithm.cost.kind, set(told.game.costs)) == ("linear", {"ring"})
    assert all(case.experiment.game.true_cost for case in by_label(study, "distance").values())


def test_the_continuous_study_has_all_methods_by_either_planner_and_variations() -> None:
    study = load_study("continuous")
    assert [case.method for case in by_label(study, "main").values()] == [None, "bics", "me_gradient"]
    assert [case.method for case in by_label(study, "soft_actor_critic").values()] == [None, "bics"]
    assert all(case.own_policies for case in by_label(study, "soft_actor_critic").values())
    tolerances = by_label(study, "tolerances")
    for method in ("ftl", "dlm"):
        cases = [case.experiment.baselines for case in tolerances.values() if case.method == method]
        settings = [getattr(baselines, method) for baselines in cases]
        assert [(of.tolerance, of.max_steps, of.steps) for of in settings] == [(t, 5, None) for t in (4.0, 2.0, 1.0)]
    variations = {label: case.experiment for label, case in by_label(study, "variations").items()}
    assert variations["sides at random"].demonstrations.side == "random"
    assert variations["neural reward"].algorithm.reward.kind == "neural"
    assert all(case.experiment.algorithm.steps.kind == "adaptive" for case in by_label(study, "variations").values())
    by_start = by_label(study, "soft_actor_critic_variations").values()
    assert [(case.experiment.demonstrations.side, case.method) for case in by_start] == [
        ("by_start", "bics"),
        ("by_start", None),
    ]
    assert {case.judged_every for case in study.cases} == {4}


def test_a_seeded_case_draws_other_demonstrations_and_rollouts() -> None:
    case = load_study("discrete").cases[0]
    seeded = case.seeded(7)
    assert (seeded.seed, seeded.demonstrations.seed) == (7, 7)
    assert seeded.model_copy(update={"seed": 1}).learners == case.experiment.learners
