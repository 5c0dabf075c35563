"""The package by itself: it loads where there is no ROS, and learns what one demonstration shows."""

import json
import subprocess
import sys

import numpy as np
import pytest

from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import simulate

LOAD_ALL = """
import importlib, pkgutil, sys
sys.modules.update(dict.fromkeys(["rclpy", "mabirds_msgs", "rcl_interfaces", "ament_index_python"]))
import mabirds_core
names = [module.name for module in pkgutil.walk_packages(mabirds_core.__path__, "mabirds_core.")]
print(len([importlib.import_module(name) for name in names]))
"""

CORRIDOR = {
    "name": "corridor",
    "game": {"kind": "patrol", "map": "...", "starts": [[[0, 0]]], "goals": [[0, 2]], "horizon": 3},
    "algorithm": {"steps": {"alpha": 2.0, "beta": 1.0}, "expectation": "exact"},
    "learners": ["left", "right"],
    "schedule": {"kind": "static"},
    "demonstrations": {"bag": "bag", "per_learner": 4},
    "iterations": 4,
    "closing_rounds": 1,
    "constraint_threshold": 0.1,
}
"""Three cells in a row: one expert walks from the first to the last."""


def test_all_modules_load_where_there_is_no_ros() -> None:
    done = subprocess.run([sys.executable, "-c", LOAD_ALL], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert int(done.stdout) > 20


def test_two_learners_agree_on_the_way_that_they_were_shown() -> None:
    experiment = Experiment.model_validate_json(json.dumps(CORRIDOR), strict=True)
    game = build_game(experiment)
    to_the_right = [int(np.flatnonzero(game.expert_successor[0, cell] == cell + 1)[0]) for cell in (0, 1)]
    to_rest = int(np.flatnonzero(game.expert_successor[0, 2] == 2)[0])
    cells = np.array([[0.0, 0.0], [0.0, 1.0], [0.0, 2.0], [0.0, 2.0]])
    shown = game.decode(cells, np.array([*to_the_right, to_rest, to_rest], dtype=float)[:, None])
    history = simulate(experiment, dict.fromkeys(experiment.learners, [shown] * 4))
    left, right = (history[name][-1] for name in experiment.learners)
    assert np.array_equal(left.theta, right.theta)
    assert np.array_equal(left.omega, right.omega)
    policy = evaluation_policy(experiment, "left", game)
    before, after = (policy(parameters) for parameters in (history["left"][0], left))
    for step in (0, 1):  # then it is at its goal
        state, action = shown.states[0, [step]], shown.actions[0, step]
        then, now = (np.exp(policy.log_probabilities(step, state))[0] for policy in (before, after))
        assert now.sum() == pytest.approx(1.0)
        assert now[action] > then[action]
        assert np.argmax(now) == action
