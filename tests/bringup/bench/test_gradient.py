"""What is left of the gradient: nothing where a policy does what was demonstrated, and more elsewhere."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mabirds_bringup.bench import gradient
from mabirds_bringup.bench.gradient import gradient_norm
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import build_game, build_learner, evaluation_policy
from mabirds_core.experiment.file import load_experiment
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.interface import Trajectories, discounted_visitation

NAME = "learner_1"


def test_it_is_that_of_rollouts_less_demonstrations_of_all(
    make_drone_experiment: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Against means over flights taken one by one; of the policy's own flights, chance alone is left."""
    experiment = load_experiment(make_drone_experiment(iterations=1))
    game: Any = build_game(experiment)
    reward: Any = build_learner(experiment, NAME).estimator.reward
    omega = np.full(len(game.cost_features.names), -0.1)
    theta, _ = build_learner(experiment, NAME).initial_state().parameters
    meaning = evaluation_policy(experiment, NAME, game)
    policy: Any = meaning(Parameters(theta, omega))
    other: Any = meaning(Parameters(theta + 2.0 * np.arange(theta.size) / theta.size, omega))
    own, others = (drone_rollouts(game, p, 200, np.random.default_rng(1)) for p in (policy, other))
    monkeypatch.setattr(gradient, "ROLLOUTS", 200)

    def mean(flights: Trajectories) -> Any:
        alone = [
            discounted_visitation(Trajectories(states[None], actions[None]), game.discount)
            for states, actions in zip(*flights, strict=True)
        ]
        each = [[*reward.gradient(theta, visits), *game.cost_features.total(visits)] for visits in alone]
        return np.mean(each, axis=0)

    def norm(*streams: Trajectories) -> float | None:
        shown = {f"learner_{k + 1}": [stream] for k, stream in enumerate(streams)}
        return gradient_norm(experiment, NAME, Parameters(theta, omega), policy, shown)

    planner: Any = build_learner(experiment, NAME).estimator.planner
    rng, starts = np.random.default_rng(experiment.seed), np.concatenate([own.states, others.states])[:, 0]
    expected = [mean(drone_rollouts(game, plan, 200, rng, starts)) for plan in planner.every_plan(theta, omega)]
    assert len(expected) == planner.rotations
    demonstrated = (mean(own) + mean(others)) / 2
    assert norm(own, others) == pytest.approx(np.linalg.norm(np.mean(expected, axis=0) - demonstrated), rel=1e-9)
    few, many = norm(own), norm(others)
    assert few is not None
    assert many is not None
    assert few < 0.5 * many
    assert gradient_norm(experiment, "bics", Parameters(theta, omega), policy, {NAME: [own]}) is None
