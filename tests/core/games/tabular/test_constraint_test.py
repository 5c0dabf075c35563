"""The counterfactual test of constraints: brute force on tiny games, gauges, and what it says of a learned patrol."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from games import all_trajectories, alone, hallway, patrol, probabilities, square
from hypothesis import given, settings
from hypothesis import strategies as st

from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Mask, Vector
from mabirds_core.experiment.assembly import build_game, reward_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.interface import Trajectories, shown_features
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.tabular import constraint_test
from mabirds_core.games.tabular.constraint_test import USED, constraint_confidences, touch_probability
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import soft_bellman_policy
from mabirds_core.rewards.models import LinearReward


def enumerated_touch(game: PatrolGame, reward: np.ndarray, touched: Mask) -> float:
    """Trajectory by trajectory."""
    trajectories = all_trajectories(game)
    chances = probabilities(game, soft_bellman_policy(game, reward), trajectories)
    return float(chances[touched[trajectories.states, trajectories.actions].any(axis=1)].sum())


def random_reward(game: PatrolGame, seed: int, scale: float = 2.0) -> np.ndarray:
    return np.random.default_rng(seed).normal(scale=scale, size=(game.n_states, game.n_actions))


def unit_table(game: PatrolGame, feature: int) -> np.ndarray:
    return game.cost_features.table(np.eye(len(game.cost_features.names))[feature])


@pytest.mark.parametrize("game", [alone(), square(), hallway()], ids=["alone", "square", "hallway"])
def test_touch_probability_is_that_over_all_trajectories(game: PatrolGame) -> None:
    reward = random_reward(game, 1)
    for feature in range(len(game.cost_features.names)):
        touched = unit_table(game, feature) > 0
        expected = enumerated_touch(game, reward, touched)
        assert touch_probability(game, reward, touched) == pytest.approx(expected, abs=1e-12)


def test_touch_probability_of_pairs_and_under_hard_constraints() -> None:
    """Pairs of any kind, not whole states alone, and rewards of -inf."""
    game = alone()
    touched = np.random.default_rng(2).random((game.n_states, game.n_actions)) < 0.2
    reward = np.where(game.violation, -np.inf, random_reward(game, 3))
    assert touch_probability(game, reward, touched) == pytest.approx(enumerated_touch(game, reward, touched), abs=1e-12)
    assert touch_probability(game, reward, game.violation) == 0
    assert touch_probability(game, reward, np.ones_like(touched)) == 1


def test_touch_probability_is_the_share_of_rollouts() -> None:
    game, count = hallway(horizon=12), 10_000
    reward = game.task_reward + random_reward(game, 4, scale=1.0)
    drawn = rollouts(game, soft_bellman_policy(game, reward), count, np.random.default_rng(5))
    shares = []
    for feature in range(len(game.cost_features.names)):
        touched = unit_table(game, feature) > 0
        share = float(touched[drawn.states, drawn.actions].any(axis=1).mean())
        chance = touch_probability(game, reward, touched)
        assert abs(share - chance) <= 4.5 * np.sqrt(chance * (1 - chance) / count) + 1e-9
        shares.append(share)
    assert min(shares) < 0.5 < max(shares)


def nine_cells() -> PatrolGame:
    return patrol("...\n.#.\n...", [((0, 0), (2, 2))], ((2, 2), (0, 0)), horizon=7)


def random_parameters(game: PatrolGame, rng: np.random.Generator, scale: float) -> Parameters:
    theta, omega = len(game.reward_features.names), len(game.cost_features.names)
    return Parameters(rng.normal(scale=scale, size=theta), rng.normal(scale=scale, size=omega))


def around(game: PatrolGame, seed: int, count: int = 1) -> Trajectories:
    """Demonstrations of soft experts."""
    rng = np.random.default_rng(seed)
    reward = np.where(game.violation, -np.inf, 3 * game.task_reward)
    return rollouts(game, soft_bellman_policy(game, reward), count, rng)


def confidences(game: PatrolGame, parameters: Parameters, demonstrations: Trajectories) -> Vector:
    return constraint_confidences(
        game, LinearReward(game.reward_features), parameters, shown_features(game, demonstrations)
    )


SEEDS = st.integers(0, 10**6)


@given(SEEDS, st.sampled_from([0.1, 1.0, 3.0]), st.floats(-5, 5), st.integers(0, 1))
@settings(max_examples=50)
def test_a_constant_on_all_cells_of_an_expert_changes_nothing(
    seed: int, scale: float, constant: float, expert: int
) -> None:
    game = nine_cells()
    parameters = random_parameters(game, np.random.default_rng(seed), scale)
    omega = parameters.omega.copy()
    omega[expert * game.n_cells : (expert + 1) * game.n_cells] += constant
    before, after = (confidences(game, of, around(game, seed)) for of in (parameters, parameters._replace(omega=omega)))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-9)


@given(SEEDS, st.sampled_from([0.1, 1.0, 3.0]))
@settings(max_examples=50)
def test_costs_of_cells_may_stand_in_theta_as_well(seed: int, scale: float) -> None:
    """Here, all of them: no cell has a cost of its own any more, and every label by threshold is another."""
    game = nine_cells()
    parameters = random_parameters(game, np.random.default_rng(seed), scale)
    theta, omega = parameters.theta.reshape(2, -1, 4), parameters.omega.copy()
    theta = theta + omega[:-2].reshape(2, -1, 1)
    omega[:-2] = 0.0
    before, after = (confidences(game, of, around(game, seed)) for of in (parameters, Parameters(theta.ravel(), omega)))
    np.testing.assert_allclose(after, before, rtol=0, atol=1e-9)


def test_what_was_shown_is_used() -> None:
    game = nine_cells()
    parameters, demonstrations = random_parameters(game, np.random.default_rng(6), 1.0), around(game, 6, count=3)
    shown = np.zeros(len(game.cost_features.names), dtype=bool)
    for feature in range(len(shown)):
        shown[feature] = (unit_table(game, feature)[demonstrations.states, demonstrations.actions] > 0).any()
    answer = confidences(game, parameters, demonstrations)
    assert (answer[shown] == USED).all()
    assert ((answer[~shown] >= 0) & (answer[~shown] <= 1)).all()
    assert 0 < shown.sum() < len(shown)


def test_the_confidence_is_that_of_so_many_demonstrations() -> None:
    """p_k by enumeration of the game in which feature k is neutral: 1 - (1 - p_k)^N."""
    game = square(horizon=2)
    demonstrations = around(game, 7)
    parameters = random_parameters(game, np.random.default_rng(7), 0.5)
    answer = confidences(game, parameters, demonstrations)
    swapping = len(answer) - 1
    assert answer[swapping] > 0
    free = parameters.omega.copy()
    free[swapping] = 0.0
    neutral = game.reward_features.table(parameters.theta) + game.cost_features.table(free)
    chance = enumerated_touch(game, neutral, unit_table(game, swapping) > 0)
    for count in (1, 5):
        many = stacked([demonstrations] * count)
        assert confidences(game, parameters, many)[swapping] == pytest.approx(1 - (1 - chance) ** count, abs=1e-12)


@given(SEEDS)
@settings(max_examples=10)
def test_learners_who_agree_name_the_same_whatever_they_saw(seed: int) -> None:
    game = nine_cells()
    parameters = random_parameters(game, np.random.default_rng(seed), 1.0)
    first, second = (confidences(game, parameters, around(game, seed + k, count=4)) for k in range(2))
    neither = (first != USED) & (second != USED)
    assert neither.any()
    np.testing.assert_array_equal(first[neither], second[neither])


LEARNED: dict[str, Any] = {
    "name": "passage",
    "game": {
        "map": ".....\n.##.#\n....#",
        "starts": [[[0, 0], [2, 3]], [[2, 0], [0, 3]]],
        "goals": [[0, 3], [2, 0]],
        "horizon": 12,
        "deadline": 9,
        "step_cost": 1.0,
    },
    "learners": ["ann", "bob"],
    "schedule": {"kind": "static"},
    "demonstrations": {"bag": "none", "per_learner": 40, "experts": "soft"},
    "iterations": 40,
    "seed": 3,
}
"""Walls between two ways, a free corner (0, 4) behind the goal, and walls that nobody comes near."""


@cache
def learned() -> tuple[PatrolGame, list[dict[str, float]]]:
    """The game, and each learner's confidences by name, after 40 demonstrations and with the default rule."""
    experiment = Experiment.model_validate(LEARNED)
    game: Any = build_game(experiment)
    rng = np.random.default_rng(3)
    streams = {name: list(game.experts("soft", "by_start").demonstrations(40, rng)) for name in experiment.learners}
    answers = []
    for name, history in simulate(experiment, streams).items():
        reward: Any = reward_of(experiment, name, game)
        answer = constraint_confidences(game, reward, history[-1], shown_features(game, stacked(streams[name])))
        answers.append(dict(zip(game.cost_features.names, answer.tolist(), strict=True)))
    return game, answers


@pytest.mark.parametrize("learner", [0, 1])
def test_walls_beside_the_ways_are_called_and_a_corner_that_nobody_needs_is_not(learner: int) -> None:
    game, answers = learned()
    answer = answers[learner]
    called = {name for name, confidence in answer.items() if confidence >= 0.95}
    walls = {f"expert_{expert} in (1, {column})" for expert in (1, 2) for column in (1, 2)}
    assert called == walls | {"sharing a cell", "swapping cells"}
    corner = [answer[f"expert_{expert} in (0, 4)"] for expert in (1, 2)]
    assert all(0 <= confidence < 0.95 for confidence in corner)
    true = dict(zip(game.cost_features.names, game.true_constraints, strict=True))
    assert all(true[name] for name in called)


def test_starts_and_goals_are_never_called() -> None:
    game, answers = learned()
    for answer in answers:
        for expert in range(2):
            for row, column in (*(start[expert] for start in game.settings.starts), game.settings.goals[expert]):
                assert answer[f"expert_{expert + 1} in ({row}, {column})"] == USED


@pytest.mark.parametrize("scale", [0.5, 5.0])
def test_by_expert_it_says_what_it_says_by_tables(scale: float, monkeypatch: pytest.MonkeyPatch) -> None:
    game = nine_cells()
    parameters, shown = random_parameters(game, np.random.default_rng(11), scale), around(game, 12)
    by_expert = confidences(game, parameters, shown)
    monkeypatch.setattr(constraint_test, "factored_reward", lambda *_: None)
    np.testing.assert_allclose(by_expert, confidences(game, parameters, shown), rtol=0, atol=1e-10)
    assert (by_expert > 0).any()
