"""The evaluation of a small run: each number against the measure that it names."""

import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.console import summary_table
from mabirds_bringup.evaluate.evaluation import LEVEL, Evaluation, constraint_rule, evaluate, summary
from mabirds_bringup.evaluate.results import write_results
from mabirds_bringup.run.certificate import Certificate
from mabirds_bringup.run.run_directory import write_json
from mabirds_core.algorithm.memory import stacked
from mabirds_core.experiment.assembly import build_game, evaluation_policy, reward_of
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History, Streams
from mabirds_core.games.interface import ShownFeatures, shown_features
from mabirds_core.metrics.constraints import by_threshold, constraint_errors, ranking_auc
from mabirds_core.metrics.curves import late_mean, late_minimum, stays_from

SOFT: dict[str, Any] = {
    "algorithm": {},
    "demonstrations": {"bag": "bag", "per_learner": 20, "experts": "soft"},
    "constraint_confidence": 0.9,
}
"""The default rule, soft experts."""


@pytest.fixture(scope="module")
def learned(make_shared_experiment: Callable[..., Path]) -> tuple[Experiment, Streams, History]:
    experiment = load_experiment(make_shared_experiment(change=SOFT, iterations=20))
    return experiment, demonstrations_of(experiment), simulate_from_bag(experiment)


@pytest.fixture(scope="module")
def evaluation(learned: tuple[Experiment, Streams, History]) -> Evaluation:
    experiment, streams, history = learned
    return evaluate(experiment, history, streams)


@pytest.fixture(scope="module")
def content(learned: tuple[Experiment, Streams, History], evaluation: Evaluation) -> dict[str, Any]:
    return summary(learned[0], evaluation, 1.5)


Learned = tuple[Experiment, Streams, History]


def test_every_learner_is_judged_at_every_iteration(learned: Learned, evaluation: Evaluation) -> None:
    experiment, _, history = learned
    assert [(row.learner, row.iteration) for row in evaluation.rows] == [
        (name, n) for name in experiment.learners for n in range(1, 22)
    ]
    game, name = build_game(experiment), "learner_2"
    policy = evaluation_policy(experiment, name, game)(history[name][-1])
    last = evaluation.of(name)[-1]
    assert (last.violation_rate, last.success_rate) == game.judge.imitation(policy, 0)


def test_likelihoods_are_of_demonstrations_that_nobody_learned_from(
    learned: Learned, evaluation: Evaluation, content: dict[str, Any]
) -> None:
    """Experts have the most, learners come to it, and who has learned nothing is far below."""
    nats = [row.held_out_log_likelihood for row in evaluation.of("learner_1")]
    assert evaluation.expert_log_likelihood is not None
    assert all(value is not None and value < evaluation.expert_log_likelihood for value in nats)
    assert nats[-1] == content["learners"]["learner_1"]["held_out_log_likelihood"]
    first, last = nats[0], nats[-1]
    assert first is not None
    assert last is not None
    assert last > first + 3
    again = evaluate(learned[0], {"learner_1": learned[2]["learner_1"][:1]}, learned[1])
    assert again.expert_log_likelihood == evaluation.expert_log_likelihood
    assert again.rows[0] == evaluation.rows[0]


def test_the_summary_names_what_it_holds(learned: Learned, content: dict[str, Any]) -> None:
    assert content["constraint_rule"] == "counterfactual test at confidence 0.9"
    assert set(content["learners"]) == set(learned[0].learners)
    assert content["fixed_log_likelihoods"] == {}  # of games whose experts' own likelihood is known
    for row in content["learners"].values():
        assert row["judges"] == {}  # of games whose evaluation planner is exact
        assert set(row) == {
            "iterations",
            "violation_rate",
            "success_rate",
            "success_first_iteration",
            "success_late_mean",
            "success_late_minimum",
            "success_stays_from_iteration",
            "held_out_log_likelihood",
            "certificate",
            "occupancy_distance",
            "judges",
            "false_positive_rate",
            "false_negative_rate",
            "false_discovery_rate",
            "auc",
            "learned_constraints",
            "undetermined",
        }
    assert json.loads(json.dumps(content)) == content


@pytest.mark.parametrize("name", ["learner_1", "learner_2"])
def test_late_values_are_those_of_the_curve(name: str, evaluation: Evaluation, content: dict[str, Any]) -> None:
    success, row = [row.success_rate for row in evaluation.of(name)], content["learners"][name]
    assert row["iterations"] == 20
    assert row["success_late_mean"] == late_mean(success)
    assert row["success_late_minimum"] == late_minimum(success) <= row["success_rate"]
    settled = stays_from(success, LEVEL)
    assert row["success_stays_from_iteration"] == (None if settled is None else settled + 1)


@pytest.mark.parametrize("name", ["learner_1", "learner_2"])
def test_constraints_are_those_of_the_games_test(
    name: str, learned: Learned, evaluation: Evaluation, content: dict[str, Any]
) -> None:
    experiment, streams, history = learned
    game, row = build_game(experiment), content["learners"][name]
    told = [stream[: None if learner == name else -1] for learner, stream in streams.items()]  # word takes an iteration
    used = shown_features(game, stacked([demonstration for stream in told for demonstration in stream])).used
    reward, shown = reward_of(experiment, name, game), ShownFeatures(used, sum(map(len, streams.values())))
    confidences = game.judge.constraint_confidences(reward, history[name][-1], shown)
    assert confidences is not None
    called = confidences >= 0.9
    assert called.any()
    names = game.cost_features.names
    assert row["learned_constraints"] == {names[k]: confidences[k] for k in np.flatnonzero(called)}
    surest = list(row["learned_constraints"].values())
    assert surest == sorted(surest, reverse=True)
    assert row["undetermined"] == int(((confidences >= 0) & ~called).sum())
    errors = constraint_errors(called, game.true_constraints)
    assert errors == tuple(row[rate] for rate in errors._fields)
    assert row["auc"] == ranking_auc(confidences, game.true_constraints)
    np.testing.assert_array_equal(evaluation.constraints[name].learned, called)


def test_the_occupancy_distance_is_to_the_experts(learned: Learned, evaluation: Evaluation) -> None:
    experiment, _, history = learned
    game = build_game(experiment)
    experts = game.experts("soft", "by_start").policy
    for name, distance in evaluation.occupancy_distance.items():
        policy = evaluation_policy(experiment, name, game)(history[name][-1])
        assert distance == game.judge.distance([policy, experts], 0)
        assert distance is not None
        assert 0 < distance < 0.5


def test_only_what_has_been_learned_from_decides_constraints(learned: Learned, evaluation: Evaluation) -> None:
    """Recordings may be longer than what was learned."""
    experiment, streams, history = learned
    longer = {name: [*stream, *streams["learner_1"]] for name, stream in streams.items()}
    constraints = evaluate(experiment, history, longer).constraints["learner_2"]
    np.testing.assert_array_equal(constraints.confidences, evaluation.constraints["learner_2"].confidences)


def test_of_an_interrupted_run_only_the_demonstrations_that_came_count(learned: Learned) -> None:
    """As if the experiment had been as short; a learner that left early counts with what it had."""
    experiment, streams, history = learned
    short = {"learner_1": history["learner_1"][:8], "learner_2": history["learner_2"][:5]}
    game = build_game(experiment)
    for name, constraints in evaluate(experiment, short, streams).constraints.items():
        reward: Any = reward_of(experiment, name, game)
        shown = reward.shown(short[name][-1].theta, 7 + 4)
        expected = game.judge.constraint_confidences(reward, short[name][-1], shown)
        np.testing.assert_array_equal(constraints.confidences, expected)


def test_a_method_without_a_reward_model_is_told_by_the_threshold(learned: Learned) -> None:
    experiment, streams, _ = learned
    short = experiment.model_copy(update={"iterations": 3})
    history = simulate_from_bag(short, "me_greedy")
    result = evaluate(short, history, streams)
    assert constraint_rule(short, result) == "learned cost -omega > 0.1"
    row = summary(short, result, 1.0)["learners"]["me_greedy"]
    expected = by_threshold(history["me_greedy"][-1].omega, 0.1)
    names = build_game(short).cost_features.names
    assert row["learned_constraints"] == {names[k]: None for k in np.flatnonzero(expected)}
    assert row["undetermined"] is None


def test_a_central_method_has_seen_all_demonstrations(learned: Learned) -> None:
    """What any learner was shown is used."""
    experiment, streams, _ = learned
    result = evaluate(experiment, {"bics": simulate_from_bag(experiment, "bics")["bics"][-1:]}, streams)
    confidences = result.constraints["bics"].confidences
    assert confidences is not None
    pooled = stacked([demonstration for stream in streams.values() for demonstration in stream])
    game: Any = build_game(experiment)
    for k in np.flatnonzero(confidences >= 0):
        unit = np.eye(len(confidences))[k]
        assert not game.cost_features.table(unit)[pooled.states, pooled.actions].any()


def text_of(content: dict[str, Any]) -> str:
    with open(os.devnull, "w", encoding="utf-8") as nowhere:  # noqa: PTH123
        console = Console(width=160, record=True, file=nowhere)
        console.print(summary_table(content))
    return " ".join(console.export_text().split())


def test_the_table_shows_the_worst_late_rate_and_the_likelihood(content: dict[str, Any]) -> None:
    text, row = text_of(content), content["learners"]["learner_2"]
    for shown in (
        "constraints by counterfactual test at confidence 0.9",
        f"experts' own likelihood {content['expert_log_likelihood']:.2f} nats",
        f"{row['success_late_minimum']:.4f}",
        f"{row['held_out_log_likelihood']:.2f}",
        f"{row['false_discovery_rate']:.3f}",
    ):
        assert shown in text
    bare = {**row, "held_out_log_likelihood": None, "undetermined": None}
    assert "own likelihood" not in text_of({**content, "expert_log_likelihood": None, "learners": {"learner_1": bare}})


def test_a_run_directory_holds_the_summary_and_a_page(
    learned: Learned, content: dict[str, Any], tmp_path: Path
) -> None:
    experiment, streams, history = learned
    certificate = Certificate([], {"learner_1": 21}, {"learner_1": "0123"}, None, [])
    written = write_results(experiment, history, streams, tmp_path, 1.5, certificate)
    assert written == {**certificate.content, **content}
    write_json(tmp_path / "expected.json", written)
    assert (tmp_path / "summary.json").read_text("utf-8") == (tmp_path / "expected.json").read_text("utf-8")
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    row = content["learners"]["learner_1"]
    for name, confidence in row["learned_constraints"].items():
        assert f"<td>{name}</td><td>{confidence:.3f}</td>" in page
    for shown in (f"and {row['undetermined']} undetermined", f"{row['held_out_log_likelihood']:.2f}"):
        assert shown in page
    header, first, *_ = (tmp_path / "metrics.csv").read_text(encoding="utf-8").splitlines()
    assert "held_out_log_likelihood" in header.split(",")
    assert first.startswith("learner_1,1,")
