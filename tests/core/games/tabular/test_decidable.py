"""How often experts without a constraint would touch it, against all trajectories of tiny games."""

import numpy as np
import pytest
from games import SlowPatrol, all_trajectories, patrol, square

from mabirds_core.arrays import Vector
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.tabular.decidable import touch_without


def enumerated(game: PatrolGame) -> Vector:
    """Each start's ways weigh exp(task reward); those that break another constraint or arrive late weigh nothing."""
    slow, (states, actions) = SlowPatrol(game.settings), all_trajectories(game)
    features = slow.feature_table(slow.cost_features)[states, actions].any(axis=1)
    weights = np.exp(game.task_reward[states, actions].sum(axis=1))
    weights[~game.goal[states[:, game.deadline :]].all(axis=1)] = 0.0
    chances = np.zeros(features.shape[1])
    for k in np.flatnonzero(game.true_constraints):
        others = game.true_constraints.copy()
        others[k] = False
        allowed = np.where(features[:, others].any(axis=1), 0.0, weights)
        for start, chance in enumerate(game.initial_distribution):
            if chance:
                own = np.where(states[:, 0] == start, allowed, 0.0)
                chances[k] += chance * own[features[:, k]].sum() / own.sum()
    return chances


def pocket() -> PatrolGame:
    """One expert past a wall, or through it: S = 6, A = 4."""
    return patrol("..\n.#\n..", [((0, 1),), ((0, 0),)], ((2, 1),), horizon=5, probabilities=[0.25, 0.75])


def past_each_other() -> PatrolGame:
    """Two experts that can pass each other on one side: S = 16, A = 16."""
    return patrol("..\n..", [((0, 0), (1, 0))], ((1, 1), (0, 1)), horizon=3)


@pytest.mark.parametrize("game", [pocket(), square(horizon=3), past_each_other()], ids=["pocket", "square", "past"])
def test_chances_are_those_over_all_trajectories(game: PatrolGame) -> None:
    chances = touch_without(game)
    assert chances.max() > 0.01
    np.testing.assert_allclose(chances, enumerated(game), rtol=0, atol=1e-12)


def test_what_is_no_constraint_has_no_chance() -> None:
    game = pocket()
    assert (touch_without(game)[~game.true_constraints] == 0).all()


def test_a_wall_that_only_late_experts_would_reach_is_not_touched() -> None:
    """The wall in the east lies two steps off the way of two steps, and the deadline leaves no step to spare."""
    game = patrol("..#\n..#", [((0, 0),)], ((1, 1),), horizon=2)
    assert (touch_without(game) == 0).all()
