"""The behaviour benchmark: its parts by hand and by brute force, and the command on two games."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from bench_command import printed
from games import central_differences, hallway, log_likelihoods, patrol, square

from mabirds_bringup.bench.behaviour.constraint_rates import (
    constraint_rates,
    rates_by_level,
)
from mabirds_bringup.bench.behaviour.counting import counting_scores
from mabirds_bringup.bench.behaviour.draw import HELD_OUT, draw, random_kind, with_paper_steps
from mabirds_bringup.bench.behaviour.misses import missed, reason
from mabirds_bringup.bench.behaviour.report import bootstrap_interval, by_problem, methods_table
from mabirds_bringup.bench.behaviour.report import targets as targets_of
from mabirds_bringup.bench.behaviour.trial import COUNTING, LEVELS, MABIRDS, PAPER, run_trial, tabular_game
from mabirds_bringup.bench.pooled import policy_of, pooled_loss, pooled_optimum
from mabirds_core.arrays import Vector
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import soft_bellman_policy

CENTRAL = ("bics", "ftl", "dlm", "me_greedy")


def some_demonstrations(game: PatrolGame, count: int = 8) -> Trajectories:
    rng = np.random.default_rng(1)
    return rollouts(game, soft_bellman_policy(game, game.task_reward - 2 * game.violation), count, rng)


def random_point(game: PatrolGame) -> Vector:
    return np.random.default_rng(2).normal(size=len(game.reward_features.names) + len(game.cost_features.names))


@pytest.mark.parametrize("game", [square(), hallway()], ids=["square", "hallway"])
def test_the_pooled_loss_is_the_negative_discounted_log_likelihood(game: PatrolGame) -> None:
    demonstrations, x = some_demonstrations(game), random_point(game)
    by_step = log_likelihoods(policy_of(game, x), demonstrations)
    expected = -(by_step * game.discount ** np.arange(game.horizon + 1)).sum(axis=1).mean()
    assert pooled_loss(game, demonstrations)(x)[0] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("game", [square(), hallway()], ids=["square", "hallway"])
def test_the_pooled_gradient_equals_finite_differences(game: PatrolGame) -> None:
    loss, x = pooled_loss(game, some_demonstrations(game)), random_point(game)
    np.testing.assert_allclose(loss(x)[1], central_differences(lambda at: loss(at)[0], x), rtol=0, atol=1e-8)


def test_the_pooled_optimum_is_more_probable_than_where_it_began() -> None:
    game = hallway(discount=1.0)
    demonstrations = some_demonstrations(game, 30)
    optimum = pooled_optimum(game, demonstrations, demonstrations)
    uniform = -(game.horizon + 1) * np.log(game.n_actions)
    assert uniform < optimum.final <= optimum.best
    held_out = rollouts(game, soft_bellman_policy(game, np.zeros_like(game.task_reward)), 30, np.random.default_rng(3))
    assert pooled_optimum(game, demonstrations, held_out).best >= uniform - 1e-9


def test_counting_by_hand() -> None:
    """One expert along the upper row: cells are one move from it once, twice or never; each time it chose 1 of 4."""
    game = patrol("...\n...\n...", [((0, 0),)], ((0, 2),), horizon=3)
    states, actions = np.array([[0, 1, 2, 2], [0, 0, 1, 2]]), np.array([[1, 1, 0, 0], [0, 1, 1, 0]])
    scores = counting_scores(game, Trajectories(states, actions))
    below_first, below_second = 1 - 0.75**3, 1 - 0.75**2  # the first cell was left three times, the second twice
    assert scores.tolist() == pytest.approx([0, 0, 0, below_first, below_second, 0, 0, 0, 0, 0, 0])


def test_counting_goes_by_pairs_too() -> None:
    """Two experts side by side, who go nowhere: both can swap, and each can walk into the other, at every step."""
    game = patrol("...", [((0, 0), (0, 1))], ((0, 2), (0, 0)), horizon=2)
    state, stay = int(game.joint_state(np.array([0, 1]))), 0
    scores = counting_scores(game, Trajectories(np.full((1, 3), state), np.full((1, 3), stay)))
    by_name = dict(zip(game.cost_features.names, scores, strict=True))
    assert by_name["swapping cells"] == pytest.approx(1 - 0.75**3)
    assert by_name["sharing a cell"] == pytest.approx(1 - 0.75**3)
    assert by_name["expert_1 in (0, 0)"] == by_name["expert_2 in (0, 1)"] == 0
    assert by_name["expert_1 in (0, 2)"] == 0


def row(method: str = MABIRDS, seed: int = 1, learner: str = "learner_1", **changes: Any) -> dict[str, Any]:
    """Made up: a learner that succeeds, half a nat below the better of the optima."""
    behaviour: dict[str, Any] = {
        "success": 1.0,
        "late_minimum": 1.0,
        "violation": 0.0,
        "occupancy_distance": 0.05,
        "nats": -8.5,
    }
    constraints = {"called": 10, "false": 0, "called_used": 0, "decidable": 5, "found": 5, "auc": 0.9}
    common = {"seed": seed, "experts": 2, "learners": 2, "schedule": "static", "demonstrations": 40}
    optima = {"pooled_nats": -9.0, "pooled_best_nats": -8.0, "pooled_best_success": 0.95}
    measured = dict.fromkeys(behaviour) if method == COUNTING else behaviour
    content = {**common, **optima, "method": method, "learner": learner, **measured, **constraints, **changes}
    at_any_level = {f"{count}_at": [content[count]] * len(LEVELS) for count in ("called", "false", "found")}
    return {**at_any_level, **content}


def test_the_worst_learner_of_a_problem_counts_in_every_measure() -> None:
    second = {"success": 0.5, "violation": 0.25, "nats": -8.1}
    third = {"late_minimum": 0.2, "occupancy_distance": 0.3, "nats": -11.0}
    made_up = [row(), row(learner="learner_2", **second), row(learner="learner_3", **third), row(seed=2)]
    worst, good = by_problem(pl.DataFrame(made_up)).to_dicts()
    assert {name: worst[name] for name in ("success", "violation", "late_minimum", "occupancy_distance")} == {
        "success": 0.5,
        "violation": 0.25,
        "late_minimum": 0.2,
        "occupancy_distance": 0.3,
    }
    assert worst["excess_nats"] == pytest.approx(3)
    assert good["excess_nats"] == pytest.approx(0.5)
    assert (worst["seed"], good["seed"]) == (1, 2)


def test_rates_of_constraints_are_over_all_learners() -> None:
    made_up = [
        row(called=8, false=2, decidable=4, found=3, auc=0.8),
        row(seed=2, called=2, false=0, decidable=6, found=5, auc=None),
        row(COUNTING, called=0, decidable=0, found=0),
    ]
    own, counting = constraint_rates(pl.DataFrame(made_up, infer_schema_length=None)).to_dicts()
    assert own["false_discovery_rate"] == pytest.approx(2 / 10)
    assert own["found"] == pytest.approx(8 / 10)
    assert own["auc"] == pytest.approx(0.8)
    assert (counting["false_discovery_rate"], counting["found"]) == (0, 1)


def test_rates_at_every_level_are_over_all_learners() -> None:
    """The lower the level, the more are called: all from 0.1, less and less up to 0.99."""
    called, found = list(range(22, 0, -2)), list(range(11, 0, -1))
    own = row(decidable=11, called_at=called, found_at=found, false_at=[1] * len(LEVELS))
    counting = row(COUNTING, called=10, decidable=11, found=5, false=3)
    made_up = pl.DataFrame([own, {**own, "learner": "learner_2"}, counting], infer_schema_length=None)
    levels = rates_by_level(made_up).filter(method=MABIRDS).to_dicts()
    assert [level["level"] for level in levels] == list(LEVELS)
    assert [level["called"] for level in levels] == [2 * count for count in called]
    assert [level["found"] for level in levels] == pytest.approx([count / 11 for count in found])
    assert [level["false_discovery_rate"] for level in levels] == pytest.approx([1 / count for count in called])


def test_a_miss_is_explained_by_its_worst_iterate() -> None:
    late = {"learner": "learner_1", "worst_iteration": 33, "worst_violation": 0.01, "worst_too_late": 0.2}
    assert reason(late) == "learner_1 at iteration 33: comes too late in 20.0% of its trajectories"
    assert "violates in 30.0%" in reason({**late, "worst_violation": 0.3})
    rows = [row(**late, late_minimum=0.79, game="map"), row(**{**late, "learner": "b"}, late_minimum=0.9, game="map")]
    (only,) = missed(pl.DataFrame([*rows, row(**late, seed=2, game="map")]), 0.99, 0.98)
    assert (only["seed"], only["learner"], only["late_minimum"], only["map"]) == (1, "learner_1", 0.79, "map")
    assert only["pooled_best_success"] == 0.95


def targets(*changed: dict[str, Any]) -> dict[str, tuple[float, bool]]:
    made_up = [row(seed=seed, **changes) for seed, changes in enumerate(changed)]
    made_up += [row(COUNTING, seed=seed, called=10, false=1, found=4) for seed in range(len(changed))]
    content = targets_of(pl.DataFrame(made_up, infer_schema_length=None))
    return {target["name"]: (target["value"], target["met"]) for target in content}


def test_targets_are_met_by_those_who_do_what_is_asked() -> None:
    verdicts = targets({}, {})
    assert all(met for _, met in verdicts.values())
    assert verdicts["found more than by counting"][0] == pytest.approx(0.2)
    assert verdicts["false discoveries more than by counting"][0] == pytest.approx(-0.1)


@pytest.mark.parametrize(
    ("changes", "missed"),
    [
        ({"success": 0.98}, "share of games where all learners succeed"),
        ({"violation": 0.02}, "share of games where all learners succeed"),
        ({"late_minimum": 0.97}, "share of games where all learners succeed"),
        ({"nats": -9.1}, "nats below the pooled optimum, median"),
        ({"occupancy_distance": 0.11}, "occupancy distance, median"),
        ({"false": 1}, "false discovery rate"),
        ({"called_used": 1}, "shown features called constraints"),
        ({"found": 3}, "decidable constraints found"),
    ],
)
def test_each_target_can_be_missed(changes: dict[str, Any], missed: str) -> None:
    assert not targets(changes)[missed][1]


def test_what_is_infinite_has_no_mean_and_is_counted() -> None:
    (shown,) = methods_table(pl.DataFrame([row(), row(seed=2, nats=-np.inf)]))
    assert shown["impossible"] == 1
    assert "excess_nats" not in shown
    assert shown["success"] == 1


def test_the_bootstrap_interval_covers_the_mean() -> None:
    """In about 95 of 100 samples; some fewer, as resampling a small sample does."""
    rng = np.random.default_rng(4)
    covered = []
    for _ in range(200):
        low, high = bootstrap_interval(rng.exponential(size=40), draws=400)
        assert low < high
        covered.append(low <= 1 <= high)
    assert 0.86 <= np.mean(covered) <= 0.99
    assert bootstrap_interval(np.array([2.0, 2.0])) == (2, 2)


def test_a_seed_draws_one_problem() -> None:
    first, again, other = (draw(seed, "patrol", 3) for seed in (6, 6, 7))
    assert first.experiment == again.experiment != other.experiment
    assert list(first.streams) == list(first.experiment.learners)
    np.testing.assert_array_equal(first.pooled.states, again.pooled.states)
    np.testing.assert_array_equal(first.held_out.actions, again.held_out.actions)
    assert len(first.held_out.states) == HELD_OUT
    assert len(first.pooled.states) == 3 * len(first.streams)


def test_drawn_experts_keep_the_constraints_and_the_deadline() -> None:
    problem = draw(6, "patrol", 3)
    game = tabular_game(problem.experiment)
    states, actions = problem.held_out
    assert not game.violation[states, actions].any()
    assert game.goal[states[:, game.deadline]].all()


def test_the_papers_steps_differ_in_the_algorithm_alone() -> None:
    experiment = draw(6, "patrol", 2).experiment
    paper = with_paper_steps(experiment)
    assert (paper.algorithm.steps.kind, paper.algorithm.window) == ("paper", 1)
    assert paper.model_copy(update={"algorithm": experiment.algorithm}) == experiment


def test_a_game_that_cannot_be_drawn_is_refused() -> None:
    assert random_kind("") == random_kind("patrol") == "patrol"
    with pytest.raises(ExperimentError, match="patrol"):
        random_kind("drones")


def small_trial() -> list[dict[str, Any]]:
    return run_trial(6, "patrol", (), 2)


@pytest.fixture(scope="module")
def trial() -> list[dict[str, Any]]:
    """One game, two demonstrations per learner."""
    return small_trial()


def test_a_trial_is_reproducible(trial: list[dict[str, Any]]) -> None:
    assert trial == small_trial()


def test_a_trial_has_a_row_per_method_and_learner(trial: list[dict[str, Any]]) -> None:
    assert [(measured["method"], measured["learner"]) for measured in trial] == [
        (method, f"learner_{number}") for method in (MABIRDS, COUNTING) for number in (1, 2)
    ]
    for measured in trial:
        assert 0 <= measured["false"] <= measured["called"]
        assert 0 <= measured["found"] <= min(measured["called"], measured["decidable"])
        assert measured["called_used"] == 0
        assert measured["pooled_nats"] <= measured["pooled_best_nats"] < 0
        assert 0 < measured["pooled_best_success"] <= 1
        assert measured["pooled_best_nats"] < measured["expert_nats"] + 0.5
    for measured in trial[:2]:
        assert 0 <= measured["late_minimum"] <= measured["success"] <= 1 - measured["violation"] + 1e-9
        assert 0 <= measured["occupancy_distance"] <= 1
    game = json.loads(trial[0]["game"])
    assert build_game(Experiment.model_validate({**draw(6, "patrol", 2).experiment.model_dump(), "game": game}))


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, dict[str, Any]]:
    """The command on two games, on one of which all methods learn: its directory, and what it printed."""
    cwd = tmp_path_factory.mktemp("behaviour")
    return cwd / "out", printed(
        cwd,
        "behaviour",
        *["--maps", "2", "--first-seed", "6", "--central-maps", "1", "--demonstrations", "2", "--out", "out"],
    )


def test_the_command_writes_a_report(report: tuple[Path, dict[str, Any]]) -> None:
    directory, content = report
    pictures = {"curves.png", "constraints.png", *(f"miss_{miss['seed']}.png" for miss in content["misses"])}
    files = {"results.parquet", "summary.json", "report.md", "report.html", *pictures}
    assert {file.name for file in directory.iterdir()} == files
    assert content == json.loads((directory / "summary.json").read_text(encoding="utf-8"))
    assert content["seeds"] == "6 to 7"
    assert content["machine"]["cores"] >= 1
    assert (directory / "curves.png").read_bytes().startswith(b"\x89PNG")
    text = (directory / "report.md").read_text(encoding="utf-8")
    for target in content["targets"]:
        assert {"name", "value", "target", "met"} <= set(target)
        assert f"| {target['name']} |" in text
    assert "2 demonstrations per learner" in text
    assert "curves.png" in (directory / "report.html").read_text(encoding="utf-8")


def test_every_method_has_its_rows(report: tuple[Path, dict[str, Any]]) -> None:
    directory, content = report
    games = {shown["method"]: shown["games"] for shown in content["methods"]}
    assert games == {MABIRDS: 2, COUNTING: 2, PAPER: 1, **dict.fromkeys(CENTRAL, 1)}
    rows = pl.read_parquet(directory / "results.parquet")
    learners = dict(rows.filter(method=MABIRDS).group_by("seed").agg(pl.len()).iter_rows())
    assert set(learners) == {6, 7}
    assert rows.filter(method=PAPER)["seed"].unique().to_list() == [6]
    assert rows.filter(pl.col("method").is_in(CENTRAL))["learner"].to_list() == list(CENTRAL)


def test_misses_are_shown_with_their_map(report: tuple[Path, dict[str, Any]]) -> None:
    directory, content = report
    text = (directory / "report.md").read_text(encoding="utf-8")
    assert content["misses"], "two demonstrations suffice nobody"
    for miss in content["misses"]:
        assert draw(miss["seed"], "patrol", 2).experiment.game.map.split("\n")[2] in text
        assert re.fullmatch(r"learner_\d at iteration \d+: (violates|comes too late) in [\d.]+% of .*", miss["reason"])
        assert miss["reason"] in text
