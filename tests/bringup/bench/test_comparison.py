"""What was learned beside what there was to learn: against measures taken by hand."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mabirds_bringup.bench.comparison import Comparison, decidable_constraints
from mabirds_bringup.bench.frame import frame_of
from mabirds_bringup.bench.outcome import drawn_streams, run_case
from mabirds_bringup.bench.study import Case
from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.interface import shown_features
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.games.tabular.decidable import touch_without

MakeExperiment = Callable[..., Path]


def rates(*success: float) -> dict[int, ImitationMetrics]:
    return {n: ImitationMetrics(0.0, rate) for n, rate in enumerate(success)}


@pytest.fixture
def compared(make_experiment: MakeExperiment) -> tuple[Comparison, dict[str, list[Parameters]]]:
    experiment = load_experiment(make_experiment(change={"algorithm": {}}, iterations=8))
    game = build_game(experiment)
    streams = drawn_streams(experiment, game)
    return Comparison.of(experiment, game, streams, optimum=True), simulate(experiment, streams)


def test_measures_are_those_of_the_final_policy(compared: tuple[Comparison, dict[str, list[Parameters]]]) -> None:
    comparison, history = compared
    experiment, game, held_out = comparison.experiment, comparison.game, comparison.held_out.demonstrations
    assert held_out is not None
    for name, parameters in history.items():
        policy = evaluation_policy(experiment, name, game)(parameters[-1])
        found = comparison.measures(name, parameters[-1], policy, rates(0.5, *[0.9] * 30))
        nats: Any = game.judge.log_likelihoods(policy, held_out)
        assert found["nats_below_optimum"] == pytest.approx(comparison.best - nats.mean())
        assert found["expert_nats"] > nats.mean()
        assert "fixed_nats" not in found
        assert found["occupancy_distance"] == game.judge.distance([policy, comparison.held_out.experts], 0)
        shown = shown_features(game, stacked(comparison.streams[name]))
        assert found["called"] <= (~shown.used).sum()
        assert 0 <= found["decidable_found"] <= 1


def test_no_learner_beats_the_optimum_by_much(compared: tuple[Comparison, dict[str, list[Parameters]]]) -> None:
    """It is the best on its demonstrations, and was stopped where held-out ones are likeliest."""
    comparison, history = compared
    for name, parameters in history.items():
        policy = evaluation_policy(comparison.experiment, name, comparison.game)(parameters[-1])
        assert comparison.measures(name, parameters[-1], policy, rates(1.0))["nats_below_optimum"] > -0.5


def test_late_and_early_failures_are_told_apart(compared: tuple[Comparison, dict[str, list[Parameters]]]) -> None:
    comparison, history = compared
    name, parameters = next(iter(history.items()))
    policy = evaluation_policy(comparison.experiment, name, comparison.game)(parameters[-1])
    after_21 = [1.0] * 21 + [0.3] + [1.0] * 20
    found = comparison.measures(name, parameters[-1], policy, rates(*after_21))
    assert (found["late_success"], found["success_after_20"], found["success_after_40"]) == (1.0, 0.3, 1.0)
    assert found["last_ten_change"] == 0.0
    falls = comparison.measures(name, parameters[-1], policy, {**rates(*after_21), 45: ImitationMetrics(0.0, 0.5)})
    assert (falls["success_after_40"], falls["late_success"]) == (0.5, 0.5)
    assert falls["last_ten_change"] == pytest.approx((6 * 1.0 + 0.5) / 7 - 0.5)
    assert "success_after_20" not in comparison.measures(name, parameters[-1], policy, rates(1.0, 0.2))


def test_what_demonstrations_can_decide(compared: tuple[Comparison, dict[str, list[Parameters]]]) -> None:
    game: Any = compared[0].game
    touch, true = touch_without(game), game.true_constraints
    few, many = (decidable_constraints(touch, true, count) for count in (2, 10**6))
    assert np.array_equal(many, true & (touch > 1e-5))
    assert few.sum() < many.sum()


def test_a_game_that_cannot_be_enumerated_has_no_optimum(make_drone_experiment: MakeExperiment) -> None:
    case = Case("main", "MA-BIRDS", load_experiment(make_drone_experiment(iterations=2)), rollouts=40, optimum=True)
    with pytest.raises(ExperimentError, match="optimum: game drones: expected one that can be enumerated"):
        run_case(case, 5)


def test_results_have_the_measures(make_experiment: MakeExperiment) -> None:
    case = Case("main", "BICS", load_experiment(make_experiment(change={"algorithm": {}}, iterations=2)), "bics")
    metrics = set(frame_of(run_case(case, 5))["metric"])
    assert {"held_out_nats", "expert_nats", "occupancy_distance", "tested_fdr", "called", "late_success"} <= metrics
    assert not {"nats_below_optimum", "decidable_found"} & metrics
