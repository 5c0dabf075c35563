"""The constrained soft Bellman policy against enumeration of every trajectory of tiny games."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from games import (
    alone,
    discounted_sums,
    hallway,
    log_likelihoods,
    patrol,
    random_policy,
    returns,
    square,
    trajectories_from,
)

from mabirds_core.arrays import Array
from mabirds_core.games.interface import TabularGame
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.interface import Policy
from mabirds_core.planners.soft_bellman import (
    SoftBellmanPlanner,
    log_sum_exp,
    soft_bellman_policy,
    soft_value_iteration,
)
from mabirds_core.rewards.models import LinearReward

pytestmark = pytest.mark.filterwarnings("error")

GAMES = [square, hallway, alone]
every_game = pytest.mark.parametrize("build", GAMES, ids=lambda build: build.__name__)
Build = Callable[[], PatrolGame]


def random_reward(game: TabularGame, seed: int = 0, scale: float = 1.0) -> Array:
    return np.random.default_rng(seed).normal(scale=scale, size=(game.n_states, game.n_actions))


def forbidding(game: TabularGame, reward: Array, penalty: float = -np.inf) -> Array:
    """``reward`` with ``penalty`` wherever the game's true constraints are broken."""
    return np.where(game.violation, penalty, reward)


def value_by_tree(game: TabularGame, reward: Array, state: int, step: int = 0) -> float:
    """V_t(s) by recursion over the tree of trajectories, in plain Python and remembering nothing."""
    if step > game.horizon:
        return 0.0
    children = (int(child) for child in game.successor[state])
    terms = (
        math.exp(own + game.discount * value_by_tree(game, reward, child, step + 1))
        for own, child in zip(reward[state].tolist(), children, strict=True)
    )
    return math.log(sum(terms))


def entropy_regularised_return(game: TabularGame, policy: Policy, reward: Array, start: int) -> float:
    """E sum_t gamma^t ( r(s_t, a_t) - log pi_t(a_t | s_t) ) by enumeration."""
    trajectories = trajectories_from(game, start)
    log_pi = log_likelihoods(policy, trajectories)
    gains = returns(game, reward, trajectories) - discounted_sums(game, log_pi)
    return float(np.exp(log_pi.sum(axis=1)) @ gains)


@pytest.mark.parametrize("game", [square(discount=1), hallway(discount=1)], ids=["square", "hallway"])
def test_undiscounted_value_is_the_log_of_the_sum_of_exp_return_over_all_trajectories(
    game: PatrolGame,
) -> None:
    reward = random_reward(game)
    values = soft_value_iteration(game, reward, game.discount)
    for start in range(game.n_states):
        enumerated = np.exp(returns(game, reward, trajectories_from(game, start))).sum()
        assert values[0, start] == pytest.approx(np.log(enumerated), abs=1e-12)


@every_game
def test_discounted_value_is_that_of_the_tree_of_trajectories(build: Build) -> None:
    game = build()
    reward = random_reward(game)
    values = soft_value_iteration(game, reward, game.discount)
    for start in np.random.default_rng(1).choice(game.n_states, size=5, replace=False):
        assert values[0, start] == pytest.approx(value_by_tree(game, reward, int(start)), abs=1e-12)


@every_game
def test_later_values_are_those_of_a_shorter_game(build: Build) -> None:
    game = build()
    reward = random_reward(game)
    values = soft_value_iteration(game, reward, game.discount)
    assert values.shape == (game.horizon + 2, game.n_states)
    for state in range(game.n_states):
        assert values[1, state] == pytest.approx(value_by_tree(game, reward, state, step=1), abs=1e-12)
    assert not values[-1].any()


@every_game
def test_the_policy_attains_its_value(build: Build) -> None:
    game = build()
    reward = random_reward(game)
    policy = soft_bellman_policy(game, reward)
    for start in np.flatnonzero(game.initial_distribution):
        attained = entropy_regularised_return(game, policy, reward, int(start))
        assert attained == pytest.approx(policy.values[0, start], abs=1e-10)


@every_game
def test_no_random_policy_attains_more(build: Build) -> None:
    game = build()
    reward, rng = random_reward(game), np.random.default_rng(2)
    best = soft_bellman_policy(game, reward).values[0]
    start = int(np.flatnonzero(game.initial_distribution)[0])
    for _ in range(10):
        assert entropy_regularised_return(game, random_policy(game, rng), reward, start) < best[start]


@every_game
def test_no_policy_for_another_reward_attains_more(build: Build) -> None:
    game = build()
    reward = random_reward(game)
    best = soft_bellman_policy(game, reward).values[0]
    start = int(np.flatnonzero(game.initial_distribution)[0])
    for seed in range(1, 6):
        near = soft_bellman_policy(game, reward + random_reward(game, seed, scale=0.1))
        assert entropy_regularised_return(game, near, reward, start) < best[start]


@every_game
def test_probabilities_sum_to_one_in_every_state_at_every_step(build: Build) -> None:
    game = build()
    policy = soft_bellman_policy(game, random_reward(game, scale=5))
    for step in range(game.horizon + 1):
        rows = np.exp(policy.log_probabilities(step, np.arange(game.n_states)))
        np.testing.assert_allclose(rows.sum(axis=1), 1, rtol=0, atol=1e-12)


def test_log_probabilities_of_some_states_are_the_rows_of_all() -> None:
    game = hallway()
    policy, chosen = soft_bellman_policy(game, random_reward(game)), np.array([7, 7, 30, 0])
    everywhere = policy.log_probabilities(1, np.arange(game.n_states))
    np.testing.assert_array_equal(policy.log_probabilities(1, chosen), everywhere[chosen])


@every_game
def test_a_constant_reward_shifts_values_and_leaves_the_policy(build: Build) -> None:
    game = build()
    plain, shifted = (soft_bellman_policy(game, random_reward(game) + shift) for shift in (0.0, 3.5))
    gained = 3.5 * sum(game.discount**step for step in range(game.horizon + 1))
    np.testing.assert_allclose(shifted.values[0], plain.values[0] + gained, atol=1e-12)
    everywhere = np.arange(game.n_states)
    for step in range(game.horizon + 1):
        np.testing.assert_allclose(
            shifted.log_probabilities(step, everywhere), plain.log_probabilities(step, everywhere), atol=1e-12
        )


def test_a_hard_constraint_has_probability_exactly_zero() -> None:
    game = hallway()
    policy = soft_bellman_policy(game, forbidding(game, random_reward(game)))
    for step in range(game.horizon + 1):
        rows = np.exp(policy.log_probabilities(step, np.arange(game.n_states)))
        assert not rows[game.violation].any()


def test_blocked_states_have_the_value_minus_infinity_and_the_others_sum_to_one() -> None:
    game = hallway()
    policy = soft_bellman_policy(game, forbidding(game, random_reward(game)))
    blocked = game.violation.all(axis=1)
    assert 0 < blocked.sum() < game.n_states
    for step in range(game.horizon + 1):
        hopeless = np.isneginf(policy.values[step])
        assert hopeless[blocked].all()
        rows = np.exp(policy.log_probabilities(step, np.arange(game.n_states)))
        np.testing.assert_allclose(rows.sum(axis=1), np.where(hopeless, 0, 1), rtol=0, atol=1e-12)


def test_a_state_with_blocked_states_all_around_is_blocked_one_step_earlier() -> None:
    """One expert in the middle of 3x3 cells, where no move stays, and its four neighbours are forbidden."""
    game = patrol("...\n...\n...", [((1, 1),)], ((0, 0),), horizon=1)
    middle = game.cell_index((1, 1))
    reward = np.zeros((game.n_states, game.n_actions))
    reward[game.successor[middle]] = -np.inf
    policy = soft_bellman_policy(game, reward)
    assert np.isfinite(policy.values[1, middle])
    assert np.isneginf(policy.values[0, middle])
    assert np.isneginf(policy.log_probabilities(0, np.array([middle]))).all()


def test_hard_constraints_give_no_nan_anywhere() -> None:
    game = hallway(horizon=5)
    policy = soft_bellman_policy(game, forbidding(game, random_reward(game)))
    assert not np.isnan(policy.values).any()
    for step in range(game.horizon + 1):
        assert not np.isnan(policy.log_probabilities(step, np.arange(game.n_states))).any()


def test_blocking_everything_gives_minus_infinity_throughout() -> None:
    game = square()
    policy = soft_bellman_policy(game, np.full((game.n_states, game.n_actions), -np.inf))
    assert np.isneginf(policy.values[:-1]).all()
    assert np.isneginf(policy.log_probabilities(0, np.arange(game.n_states))).all()


def test_hard_constraints_are_the_limit_of_large_costs() -> None:
    game = hallway()
    rewards = (forbidding(game, random_reward(game), penalty) for penalty in (-np.inf, -200.0))
    hard, soft = (soft_bellman_policy(game, reward) for reward in rewards)
    alive = np.flatnonzero(np.isfinite(hard.values[0]))
    np.testing.assert_allclose(soft.values[0, alive], hard.values[0, alive], atol=1e-12)
    for step in range(game.horizon + 1):
        alive = np.flatnonzero(np.isfinite(hard.values[step]))
        one, other = (np.exp(policy.log_probabilities(step, alive)) for policy in (hard, soft))
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-12)


@pytest.mark.parametrize("size", [1e4, -1e4, 1e8])
def test_very_large_rewards_neither_overflow_nor_vanish(size: float) -> None:
    game = hallway()
    policy = soft_bellman_policy(game, size + random_reward(game, scale=abs(size)))
    assert np.isfinite(policy.values).all()
    for step in range(game.horizon + 1):
        rows = np.exp(policy.log_probabilities(step, np.arange(game.n_states)))
        np.testing.assert_allclose(rows.sum(axis=1), 1, rtol=0, atol=1e-6)


def test_very_large_rewards_make_the_policy_greedy() -> None:
    game = hallway()
    reward = random_reward(game, scale=1e4)
    best = reward.argmax(axis=1)
    rows = np.exp(soft_bellman_policy(game, reward).log_probabilities(game.horizon, np.arange(game.n_states)))
    np.testing.assert_allclose(rows[np.arange(game.n_states), best], 1, atol=1e-12)


def test_the_planner_weighs_reward_features_by_theta_and_cost_features_by_omega() -> None:
    game, rng = hallway(), np.random.default_rng(4)
    model = LinearReward(game.reward_features)
    theta, omega = rng.normal(size=model.size), rng.normal(size=len(game.cost_features.names))
    found = SoftBellmanPlanner(game, model, game.cost_features).plan(theta, omega)
    reward = game.reward_features.table(theta) + game.cost_features.table(omega)
    np.testing.assert_allclose(found.values, soft_bellman_policy(game, reward).values, rtol=1e-13)


def test_log_sum_exp_of_known_rows() -> None:
    rows = np.array([[0.0, 0.0], [-np.inf, 2.0], [-np.inf, -np.inf], [1e4, 1e4], [-1e4, -1e4]])
    expected = [np.log(2), 2.0, -np.inf, 1e4 + np.log(2), -1e4 + np.log(2)]
    np.testing.assert_allclose(log_sum_exp(rows), expected, rtol=1e-15)
