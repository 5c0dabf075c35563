"""The shipped example of the patrol game's options, as its documentation tells of it."""

from pathlib import Path

import numpy as np
import pytest

from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.games.patrol.whole_game import WholePatrolGame
from mabirds_core.games.truth import known_rates

HALL = Path(__file__).parents[4] / "ros_ws" / "config" / "hall.yaml"


def test_the_hall_has_the_options_that_the_documentation_names() -> None:
    settings = load_experiment(HALL).game
    assert isinstance(settings, PatrolSettings)
    assert settings.waiting
    assert settings.diagonals
    assert settings.leaving
    assert settings.slip > 0
    assert max(len(cells) for cells in settings.goal_cells) > 1


def test_learners_in_the_hall_do_as_experts_do() -> None:
    """Who slips breaks constraints now and then, experts too: learners nearly as seldom, and as often in time."""
    experiment = load_experiment(HALL).model_copy(update={"iterations": 20})
    game = build_game(experiment)
    assert isinstance(game, WholePatrolGame)
    experts = game.experts("soft", "by_start")
    own = known_rates(game.judge, experts.policy, 0)
    streams = {
        name: list(experts.demonstrations(20, np.random.default_rng([1, index])))
        for index, name in enumerate(experiment.learners)
    }
    last = simulate(experiment, streams)["learner_1"][-1]
    learned = known_rates(game.judge, evaluation_policy(experiment, "learner_1", game)(last), 0)
    assert 0.02 < own.violation_rate < 0.1
    assert learned.violation_rate == pytest.approx(own.violation_rate, abs=0.03)
    assert learned.success_rate > own.success_rate - 0.06
