"""The reward parameter of being late, against trajectories that are, and against a terminal value."""

from typing import cast

import numpy as np
import pytest
from games import alone, hallway, trio
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.interface import discounted_visitation
from mabirds_core.games.patrol.arrival import LATE_SCALE, ArrivingReward
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.factored import factored_policy, factored_reward
from mabirds_core.planners.occupancy import ExactOccupancy, rollouts
from mabirds_core.planners.soft_bellman import log_sum_exp, soft_bellman_policy

GAMES = {"one expert": alone(), "two experts": hallway(), "three experts": trio()}
every_game = pytest.mark.parametrize("name", GAMES)


def model(game: PatrolGame) -> ArrivingReward:
    return cast("ArrivingReward", game.arriving_reward())


def lateness_only(game: PatrolGame, worth: Vector) -> Vector:
    """theta that speaks of lateness alone."""
    return np.concatenate([np.zeros(model(game).total_size), worth])


@every_game
@given(seed=st.integers(0, 10**6))
def test_its_count_is_one_discounted_where_an_expert_is_under_way_after_the_last_step(name: str, seed: int) -> None:
    game, rng = GAMES[name], np.random.default_rng(seed)
    theta = rng.normal(size=model(game).size)
    policy = soft_bellman_policy(game, model(game).table(theta))
    for _ in range(3):
        walked = rollouts(game, policy, 1, rng)
        after = game.successor[walked.states[0, -1], walked.actions[0, -1]]
        late = game.cells(np.array([after]))[:, 0] != np.argmax(game.grid.is_goal, axis=1)
        begun = game.cells(walked.states[0, :1])[:, 0] != np.argmax(game.grid.is_goal, axis=1)
        counts = model(game).gradient(theta, discounted_visitation(walked, game.discount))
        expected = LATE_SCALE * np.where(begun, game.discount ** (game.horizon + 1) * late, 1.0)
        np.testing.assert_allclose(counts[model(game).total_size :], expected, rtol=0, atol=1e-12)


@every_game
def test_the_policy_is_that_of_a_terminal_value(name: str) -> None:
    game = GAMES[name]
    worth = np.random.default_rng(3).normal(size=game.n_experts)
    reward = model(game).table(lateness_only(game, worth))
    found = soft_bellman_policy(game, reward)
    under_way = np.not_equal(game.cells(np.arange(game.n_states)), np.argmax(game.grid.is_goal, axis=1)[:, None])
    values = LATE_SCALE * worth @ under_way
    for step in range(game.horizon, -1, -1):
        ahead = game.discount * values[game.successor]
        values = log_sum_exp(ahead)
        found_here = found.log_probabilities(step, np.arange(game.n_states))
        np.testing.assert_allclose(found_here, ahead - values[:, None], rtol=0, atol=1e-10)


@every_game
def test_by_expert_it_is_the_same_policy_and_the_same_gradient(name: str) -> None:
    game, reward, rng = GAMES[name], model(GAMES[name]), np.random.default_rng(4)
    theta, omega = rng.normal(size=reward.size), rng.normal(size=len(game.cost_features.names))
    by_expert = factored_reward(reward, game.cost_features, theta, omega)
    if by_expert is None:
        pytest.skip("the kernels are not compiled")
    factored = factored_policy(game, by_expert)
    whole = soft_bellman_policy(game, reward.table(theta) + game.cost_features.table(omega))
    expected, found = (reward.gradient(theta, ExactOccupancy(game)(policy, rng)) for policy in (whole, factored))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


@every_game
def test_the_reward_is_linear_in_theta_with_its_gradient(name: str) -> None:
    game, reward, rng = GAMES[name], model(GAMES[name]), np.random.default_rng(5)
    theta = rng.normal(size=reward.size)
    walked = rollouts(game, soft_bellman_policy(game, np.zeros((game.n_states, game.n_actions))), 5, rng)
    visitation = discounted_visitation(walked, game.discount)
    table = cast("Array", reward.table(theta))
    total = (visitation.weights * table[visitation.states, visitation.actions]).sum()
    assert total == pytest.approx(theta @ reward.gradient(theta, visitation), abs=1e-10)


def test_a_start_at_the_goal_tells_nothing() -> None:
    game = hallway()
    goals = np.argmax(game.grid.is_goal, axis=1)
    at_goal = [model(game).late[expert, goal] for expert, goal in enumerate(goals)]
    steps = sum(game.discount**step for step in range(game.horizon + 1))
    np.testing.assert_allclose(at_goal, LATE_SCALE / steps, atol=1e-12)


def test_names_say_who_is_late() -> None:
    reward = model(hallway())
    assert reward.names[-2:] == ("expert_1 late", "expert_2 late")
    assert len(reward.names) == reward.size
