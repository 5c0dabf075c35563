"""From settings to objects: every setting arrives where it belongs."""

import pytest
from experiments import experiment

from mabirds_core.algorithm.adaptive_steps import AdaptiveSteps
from mabirds_core.algorithm.memory import RunningMean, WindowMemory
from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.consensus.strict import StrictMixer
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, build_learner
from mabirds_core.planners.occupancy import ExactOccupancy, SampledOccupancy


def test_a_learner_has_the_settings_of_its_experiment() -> None:
    steps = {"alpha": 5.0, "beta": 6.0, "eta1": 0.7, "eta2": 0.8}
    settings = experiment({"algorithm.window": 3, "algorithm.steps": steps})
    learner = build_learner(settings, "cid")
    assert (learner.index, learner.seed) == (2, settings.seed)
    assert isinstance(learner.memory, WindowMemory)
    assert learner.memory.length == 3
    assert learner.steps == PaperSteps(**steps)
    assert learner.mixer == StrictMixer("cid", settings.edge_schedule)
    assert learner.game.digest == build_game(settings).digest


def test_without_settings_a_learner_needs_no_numbers() -> None:
    learner = build_learner(experiment({"algorithm": {}}), "ann")
    assert learner.steps == AdaptiveSteps()
    assert isinstance(learner.memory, RunningMean)
    assert learner.estimator.rollout_start == "demonstration"
    assert isinstance(learner.estimator.expectation, ExactOccupancy)


def test_the_expectation_is_that_of_the_settings() -> None:
    sampled = build_learner(experiment({"algorithm.rollouts": 17}), "ann").estimator.expectation
    exact = build_learner(experiment({"algorithm.expectation": "exact"}), "ann").estimator.expectation
    assert isinstance(sampled, SampledOccupancy)
    assert sampled.count == 17
    assert isinstance(exact, ExactOccupancy)


def test_a_game_that_is_given_is_used() -> None:
    game = build_game(experiment())
    assert build_learner(experiment(), "ann", game).game is game


def test_a_learner_that_the_experiment_does_not_have_is_refused_by_name() -> None:
    with pytest.raises(ExperimentError, match="'dan' is none of the learners"):
        build_learner(experiment(), "dan")
