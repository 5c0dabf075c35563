"""Checks of rewards, costs and planners."""

from functools import partial
from typing import Any

import numpy as np

from mabirds_core.arrays import Vector
from mabirds_core.conformance.expectations import (
    by_table,
    differences_of,
    require,
    visitations,
)
from mabirds_core.conformance.settings import check_settings
from mabirds_core.costs.models import CostModel
from mabirds_core.games.whole_game import Game
from mabirds_core.planners.interface import Planner, Policy, TabularPolicy
from mabirds_core.registry import Kind
from mabirds_core.rewards.models import RewardModel


def check_reward(model: RewardModel, game: Game, seed: int = 0) -> None:
    """Check shapes, and for tables the gradient against finite differences.

    Parameters
    ----------
    model : RewardModel
        r_theta.
    game : Game
        A small one that it fits.
    seed : int, optional
        Of theta and demonstrations.
    """
    rng = np.random.default_rng(seed)
    theta = model.initial(rng)
    require(theta.shape == (model.size,), f"initial: shape {theta.shape}, expected ({model.size},)")
    first, second = (model.initial(np.random.default_rng(3)) for _ in range(2))
    require(np.array_equal(first, second), "initial: expected the same theta(1) from the same seed")
    for visitation in visitations(game, seed):
        theta = rng.normal(size=model.size)
        gradient = model.gradient(theta, visitation)
        require(gradient.shape == (model.size,), f"gradient: shape {gradient.shape}, expected ({model.size},)")
        table = getattr(model, "table", None)
        if table is not None:
            differences = differences_of(partial(by_table, table, visitation), theta)
            require(np.allclose(gradient, differences, atol=1e-4), "gradient: expected that of the reward's table")


def check_costs(model: CostModel, game: Game, seed: int = 0) -> None:
    """Check shapes, gradients against finite differences of the table, and totals.

    Parameters
    ----------
    model : CostModel
        -c_omega.
    game : Game
        A small tabular one that it fits.
    seed : int, optional
        Of omega and demonstrations.
    """
    rng, features = np.random.default_rng(seed), len(game.cost_features.names)
    first, second = (model.initial(np.random.default_rng(3)) for _ in range(2))
    require(first.shape == (model.size,), f"initial: shape {first.shape}, expected ({model.size},)")
    require(np.array_equal(first, second), "initial: expected the same omega(1) from the same seed")
    require(len(model.names) in {0, model.size}, f"names: {len(model.names)}, expected none or {model.size}")
    for visitation in visitations(game, seed):
        omega, total = rng.normal(size=model.size), model.total(visitation)
        require(total.shape == (model.total_size,), f"total: shape {total.shape}, expected ({model.total_size},)")
        same = np.array_equal(total[:features], game.cost_features.total(visitation))
        require(same, "total: expected the totals of the game's cost features first")
        differences = differences_of(partial(by_table, model.table, visitation), omega)
        close = np.allclose(model.gradient_of_total(omega, total), differences, atol=1e-4)
        require(close, "gradient_of_total: expected that of the table")
        weights = model.by_feature(omega)
        require(weights.shape == (features,), f"by_feature: shape {weights.shape}, expected ({features},)")
        require(model.penalty_gradient(omega).shape == omega.shape, f"penalty_gradient: expected shape {omega.shape}")


def check_cost_feature(kind: Kind, content: dict[str, object], places: Any, states: int) -> None:
    """Check settings, and values: one finite number for each joint state, the same each time.

    Parameters
    ----------
    kind : Kind
        Of "mabirds.cost_features".
    content : dict[str, object]
        Its settings, as of an experiment file.
    places : Any
        Where experts are, as the game tells its cost features.
    states : int
        S: joint states of the game, a small one.
    """
    settings = check_settings(kind, content)
    first, second = (np.asarray(kind.build(settings, places)) for _ in range(2))
    require(first.shape == (states,), f"values: shape {first.shape}, expected ({states},), one for each joint state")
    require(bool(np.isfinite(first).all()), "values: expected finite numbers for all joint states")
    require(np.array_equal(first, second), "values: expected the same each time")


def check_planner(planner: Planner, game: Game, reward: RewardModel, seed: int = 0) -> None:
    """Check for the same policy from the same arguments, probabilities, and a memory that serves as the policy did.

    Parameters
    ----------
    planner : Planner
        Of the game and the reward.
    game : Game
        A small one.
    reward : RewardModel
        r_theta.
    seed : int, optional
        Of theta and omega.
    """
    rng = np.random.default_rng(seed)
    theta, omega = rng.normal(size=reward.size), rng.normal(size=len(game.cost_features.names))
    first, second = (planner.plan(theta, omega, rng=np.random.default_rng(1)) for _ in range(2))
    same = np.array_equal(_followed(game, first), _followed(game, second))
    require(same, "find: expected the same policy from the same arguments")
    if hasattr(first, "log_probabilities"):
        _check_probabilities(first, game)
    memory = planner.state_dict(first)
    recalled = planner.load_state_dict(memory) if memory else None
    kept, resumed = (planner.plan(theta, omega, before, np.random.default_rng(4)) for before in (first, recalled))
    same = np.array_equal(_followed(game, kept), _followed(game, resumed))
    require(same, "load_state_dict(state_dict(policy)): expected it to serve a search as the policy does")


def _followed(game: Game, policy: Policy) -> Vector:
    """Totals of the cost features over what a policy does, shape (K,)."""
    visits = game.expectation(game.expectations[0], 50)(policy, np.random.default_rng(2))
    steps = sum(game.discount**step for step in range(game.horizon + 1))
    require(bool(np.isclose(visits.weights.sum(), steps)), "expectation: expected weights of T + 1 discounted steps")
    return game.cost_features.total(visits)


def _check_probabilities(policy: TabularPolicy, game: Game) -> None:
    visits = game.expectation(game.expectations[0], 50)(policy, np.random.default_rng(2))
    for step in (0, game.horizon):
        sums = np.exp(policy.log_probabilities(step, np.unique(visits.states))).sum(axis=1)
        require(np.allclose(sums[sums > 0], 1), "log_probabilities: expected probabilities that sum to 1")
