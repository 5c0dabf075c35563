"""Likelihoods of demonstrations against steps multiplied one by one, and against the mass of all trajectories."""

import numpy as np
import pytest
from games import (
    SlowPatrol,
    TablePolicy,
    all_trajectories,
    alone,
    hallway,
    patrol,
    random_policy,
    trajectories_from,
)

from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.metrics.likelihood import log_likelihoods
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner
from mabirds_core.rewards.models import LinearReward


@pytest.mark.parametrize("game", [alone(), hallway(horizon=1)], ids=["alone", "hallway"])
def test_only_steps_on_the_way_are_multiplied(game: PatrolGame) -> None:
    policy, trajectories = random_policy(game, np.random.default_rng(1)), all_trajectories(game)
    slow = SlowPatrol(game.settings)
    expected = []
    for states, actions in zip(*trajectories, strict=True):
        chance = 1.0
        for step, (state, action) in enumerate(zip(states, actions, strict=True)):
            if slow.waiting(slow.states[state]):
                chance *= policy.probabilities[step, state, action]
        expected.append(np.log(chance))
    np.testing.assert_allclose(log_likelihoods(game, policy, trajectories), expected, rtol=0, atol=1e-12)


def test_the_ways_from_a_start_have_mass_one() -> None:
    """Trajectories that differ after the arrival alone are one way: A^k of them for k steps at the goal."""
    game = alone()
    for start in np.flatnonzero(game.initial_distribution):
        trajectories = trajectories_from(game, int(start))
        at_goal = game.goal[trajectories.states].sum(axis=1)
        chances = np.exp(log_likelihoods(game, random_policy(game, np.random.default_rng(2)), trajectories))
        assert at_goal.max() > 0
        assert (chances / game.n_actions**at_goal).sum() == pytest.approx(1, abs=1e-12)


def test_likelihoods_by_hand() -> None:
    """Two cells to the east with probability 1/2 each; the move at the goal has probability 0 and does not count."""
    game = patrol("...", [((0, 0),)], ((0, 2),), horizon=2)
    chances = np.broadcast_to([0.0, 0.5, 0.25, 0.25], (3, 3, 4))
    states, actions = np.array([[0, 1, 2], [0, 0, 1], [0, 0, 1]]), np.array([[1, 1, 0], [2, 1, 3], [0, 1, 3]])
    nats = log_likelihoods(game, TablePolicy(chances), Trajectories(states, actions))
    assert nats.tolist() == pytest.approx([np.log(1 / 4), np.log(1 / 32), -np.inf])


def test_no_demonstration_has_no_likelihood() -> None:
    game = alone()
    none = Trajectories(np.empty((0, 4), dtype=np.int64), np.empty((0, 4), dtype=np.int64))
    assert log_likelihoods(game, random_policy(game, np.random.default_rng(3)), none).shape == (0,)


def test_all_steps_at_once_are_as_step_by_step_to_the_last_bit() -> None:
    game, rng = hallway(horizon=5), np.random.default_rng(4)
    reward = LinearReward(game.reward_features)
    theta, omega = rng.normal(size=reward.size), -rng.exponential(size=len(game.cost_features.names))
    policy = SoftBellmanPlanner(game, reward, game.cost_features).plan(theta, omega)
    states, actions = rng.integers(game.n_states, size=(30, 6)), rng.integers(game.n_actions, size=(30, 6))
    assert hasattr(policy, "log_likelihoods")
    total = np.zeros(30)
    for step in range(6):
        under_way = np.flatnonzero(~game.goal[states[:, step]])
        chances = policy.log_probabilities(step, states[under_way, step])
        total[under_way] += chances[np.arange(len(under_way)), actions[under_way, step]]
    assert log_likelihoods(game, policy, Trajectories(states, actions)).tobytes() == total.tobytes()
