"""Settings of tiny experiments, and demonstrations for them that need no ROS and no experts."""

from copy import deepcopy
from typing import Any

import numpy as np

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import soft_bellman_policy

SETTINGS: dict[str, Any] = {
    "name": "tiny",
    "game": {
        "map": "...\n.#.",
        "starts": [[[0, 0], [0, 2]]],
        "goals": [[1, 2], [1, 0]],
        "horizon": 4,
    },
    "algorithm": {
        "steps": {"alpha": 2.0, "beta": 1.0},
        "window": 1,
        "expectation": "sampled",
        "rollouts": 5,
        "rollout_start": "initial",
    },
    "learners": ["ann", "bob", "cid"],
    "schedule": {"kind": "static"},
    "demonstrations": {"bag": "bag", "per_learner": 12},
    "iterations": 12,
    "seed": 3,
    "constraint_threshold": 0.1,
}


def changed(changes: dict[str, Any], of: dict[str, Any] = SETTINGS) -> dict[str, Any]:
    """``of`` with some values replaced, named by dotted path: {"game.horizon": 3, "game.obstacles.0.radius": 2}."""
    content = deepcopy(of)
    for path, value in changes.items():
        *parents, last = path.split(".")
        place: Any = content
        for parent in parents:
            place = place[int(parent) if isinstance(place, list) else parent]
        place[last] = value
    return content


def experiment(changes: dict[str, Any] | None = None) -> Experiment:
    """The tiny experiment with some settings changed."""
    return Experiment.model_validate(changed(changes or {}))


def demonstrations(of: Experiment, seed: int = 0) -> dict[str, list[Trajectories]]:
    """A stream per learner, of a soft policy that hurries to the goal and breaks no true constraint."""
    game, rng = build_game(of), np.random.default_rng(seed)
    policy = soft_bellman_policy(game, np.where(game.violation, -np.inf, 4 * game.task_reward))
    return {name: [rollouts(game, policy, 1, rng) for _ in range(of.iterations)] for name in of.learners}
