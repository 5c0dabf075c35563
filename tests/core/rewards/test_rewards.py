"""The linear reward model; its gradient against finite differences is in test_gradients.py."""

import numpy as np
from games import hallway, random_policy

from mabirds_core.planners.occupancy import ExactOccupancy
from mabirds_core.rewards.models import LinearReward


def test_a_linear_reward_starts_at_zero_for_every_seed() -> None:
    model = LinearReward(hallway().reward_features)
    for seed in (0, 1):
        np.testing.assert_array_equal(model.initial(np.random.default_rng(seed)), np.zeros(model.size))


def test_a_linear_reward_is_linear_in_theta() -> None:
    model, rng = LinearReward(hallway().reward_features), np.random.default_rng(0)
    one, other = rng.normal(size=(2, model.size))
    expected = 2 * model.table(one) - model.table(other)
    np.testing.assert_allclose(model.table(2 * one - other), expected, atol=1e-12)


def test_its_gradient_does_not_depend_on_theta() -> None:
    game, rng = hallway(), np.random.default_rng(0)
    model, visitation = (
        LinearReward(game.reward_features),
        ExactOccupancy(game)(random_policy(game, rng), rng),
    )
    zeros, ones = np.zeros(model.size), np.ones(model.size)
    at_zero, elsewhere = (model.gradient(theta, visitation) for theta in (zeros, ones))
    np.testing.assert_array_equal(at_zero, elsewhere)
    assert at_zero.any()


def test_its_size_is_one_an_expert_cell_and_move() -> None:
    assert LinearReward(hallway().reward_features).size == 2 * 6 * 4
