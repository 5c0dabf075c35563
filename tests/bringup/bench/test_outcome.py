"""What a case comes to: against the simulation, and twice the same."""

import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

from mabirds_bringup.bench.frame import array_of, frame_of, is_entry
from mabirds_bringup.bench.outcome import drawn_streams, run_case
from mabirds_bringup.bench.study import Case
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.metrics.constraints import by_threshold, constraint_errors

MakeExperiment = Callable[..., Path]

EXACT = {"algorithm": {"steps": {"alpha": 8.0, "beta": 4.0}, "expectation": "exact"}}
MEASURED = pl.col("metric").is_in(["seconds", "peak_memory"])


@pytest.fixture
def few_flights(monkeypatch: pytest.MonkeyPatch) -> None:
    """What drones do is judged by few flights of theirs and of the experts: rates need not be exact here."""
    monkeypatch.setattr("mabirds_bringup.evaluate.held_out.HELD_OUT_BY_SEARCH", 20)
    monkeypatch.setattr("mabirds_bringup.evaluate.verdicts.ROLLOUTS", 100)


@pytest.fixture
def no_verdicts(few_flights: None, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nor by planners that took no part."""
    monkeypatch.setattr("mabirds_bringup.bench.outcome.verdicts", lambda *of: {name: {} for name in of[-1]})


def at(results: pl.DataFrame, metric: str) -> list[float]:
    return results.filter(metric=metric).sort("iteration")["value"].to_list()


def test_a_result_is_what_the_simulation_came_to(make_experiment: MakeExperiment) -> None:
    case = Case("main", "MA-BIRDS", load_experiment(make_experiment(change={**EXACT, "closing_rounds": 1})))
    experiment = case.seeded(5)
    game = build_game(experiment)
    history = simulate(experiment, drawn_streams(experiment, game))
    results = frame_of(run_case(case, 5))
    assert results["learner"].unique(maintain_order=True).to_list() == [*experiment.learners] == [*history]
    for learner, parameters in history.items():
        own, last = results.filter(learner=learner, seed=5), parameters[-1]
        policy = evaluation_policy(experiment, learner, game)
        rates = [game.judge.imitation(policy(theta_omega), 5) for theta_omega in parameters]
        assert at(own, "success_rate") == [rate.success_rate for rate in rates]
        assert at(own, "violation_rate") == [rate.violation_rate for rate in rates]
        assert own.filter(metric="seconds")["iteration"].to_list() == list(range(1, 7))
        assert at(own, "gradient_steps") == [experiment.iterations]
        np.testing.assert_allclose(array_of(own, "theta"), last.theta, rtol=0, atol=1e-6)
        np.testing.assert_allclose(array_of(own, "omega"), last.omega, rtol=0, atol=1e-6)
        errors = constraint_errors(by_threshold(last.omega, experiment.constraint_threshold), game.true_constraints)
        for metric, value in errors._asdict().items():
            assert at(own, metric) == [value]


def test_learners_that_agree_are_told(make_experiment: MakeExperiment) -> None:
    """A full graph of two agrees after one round; without it, they have their own answers."""
    experiment = load_experiment(make_experiment(change=EXACT))
    apart, agreed = (
        frame_of(run_case(Case("main", "MA-BIRDS", experiment.model_copy(update={"closing_rounds": rounds})), 5))
        for rounds in (0, 1)
    )
    theta = at(agreed.filter(learner="learner_1"), "consensus_theta")
    assert theta[6] > theta[7] == pytest.approx(0, abs=1e-9)
    assert at(apart.filter(learner="learner_1"), "consensus_theta") == theta[:-1]
    assert set(at(agreed, "same_constraints")) == {1.0}
    assert at(agreed, "policy_distance") == pytest.approx([0, 0], abs=1e-9)
    assert min(at(apart, "policy_distance")) > 0.01


def test_a_seed_repeats_and_another_does_not(make_experiment: MakeExperiment) -> None:
    case = Case("main", "BICS", load_experiment(make_experiment(change=EXACT)), "bics")
    first, again, other = (frame_of(run_case(case, seed)).remove(MEASURED) for seed in (5, 5, 6))
    assert first.equals(again)
    assert at(first, "success_rate") != at(other, "success_rate")


@pytest.mark.usefixtures("no_verdicts")
def test_games_that_are_judged_by_rollouts_take_as_many_as_they_are_told(make_drone_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_drone_experiment(iterations=3)).model_copy(update={"closing_rounds": 2})
    case = Case("lattice", "MA-BIRDS", experiment, rollouts=40)
    results = frame_of(run_case(case, 5)).filter(learner="learner_1")
    last, others = [0, 3, 5][1:], [0, 1, 2, 4]
    rates = at(results, "violation_rate")
    assert all((rates[n] * 4).is_integer() for n in others)
    assert all((rates[n] * 40) == pytest.approx(round(rates[n] * 40)) for n in last)
    things = results.filter(is_entry("obstacle_cost"))["metric"].to_list()
    assert things == [f"obstacle_cost[(1.5, 1.5) m, drone {drone}]" for drone in (1, 2)]
    more = frame_of(run_case(replace(case, rollouts=80), 5)).filter(learner="learner_1")
    assert at(more, "consensus_theta") == at(results, "consensus_theta")


def test_some_iterations_are_judged_and_the_last_ones_always(make_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_experiment(change={**EXACT, "closing_rounds": 1}, iterations=5))
    every, third = (frame_of(run_case(Case("main", "", experiment, judged_every=n), 5)) for n in (1, 3))
    rates = third.filter(learner="learner_1", metric="success_rate")
    assert rates["iteration"].to_list() == [0, 3, 5, 6]
    for metric in ("success_rate", "held_out_nats", "violation_rate"):
        assert third.filter(metric=metric).join(every, on=third.columns, nulls_equal=True).height == 2 * 4


@pytest.mark.usefixtures("few_flights")
def test_what_planners_that_took_no_part_find_is_kept(make_drone_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_drone_experiment(iterations=2))
    results = frame_of(run_case(Case("main", "", experiment, "bics", rollouts=40), 5))
    rates = results.filter(is_entry("judge_success"))
    assert rates["metric"].to_list() == [
        f"judge_success[{judge}]" for judge in ("hexagonal 0.125 m", "square 0.112 m", "hexagonal 0.094 m")
    ]
    assert at(results, "least_judge_success") == [rates["value"].min()]
    values = results.filter(is_entry("judge_value"))["value"]
    assert at(results, "judge_value_range") == [pytest.approx(values.max() - values.min())]
    assert results.filter(is_entry("judge_gap"))["value"].max() < 0.1
    assert len(results.filter(is_entry("judge_nats"))) == len(results.filter(is_entry("judge_fixed"))) == 3


@pytest.mark.usefixtures("no_verdicts")
def test_policies_that_learners_planned_are_judged_with_their_gaps(make_drone_experiment: MakeExperiment) -> None:
    experiment = load_experiment(make_drone_experiment("soft_actor_critic", iterations=2))
    for method in (None, "bics"):
        for result in run_case(Case("main", "", experiment, method, own_policies=True, rollouts=40), 5):
            own = frame_of([result])
            for metric in ("actor_success_rate", "actor_violation_rate", "actor_gap"):
                assert len(at(own, metric)) == 2
            assert len(at(own, "success_rate")) == 3


def test_policies_are_judged_only_where_it_is_asked_for(make_experiment: MakeExperiment) -> None:
    experiment: Any = load_experiment(make_experiment(change=EXACT, iterations=2))
    assert at(frame_of(run_case(Case("main", "", experiment), 5)), "actor_success_rate") == []


def test_peak_memory_is_that_of_the_process() -> None:
    program = (
        "from mabirds_bringup.bench.outcome import peak_memory\nimport numpy as np\nbefore = peak_memory()\n"
        "grown = np.ones(20_000_000)\ndel grown\nprint(peak_memory() - before)"
    )
    grown = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert float(grown.stdout) == pytest.approx(160, abs=15)
