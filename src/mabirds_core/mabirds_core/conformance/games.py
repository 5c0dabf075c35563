"""Checks of games."""

import numpy as np

from mabirds_core.arrays import Array
from mabirds_core.conformance.expectations import (
    DEMONSTRATIONS,
    fails,
    require,
)
from mabirds_core.conformance.models import check_reward
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.interface import FeatureMap, Trajectories, Visitation, discounted_visitation
from mabirds_core.games.whole_game import Game


def check_game(game: Game, seed: int = 0) -> None:
    """Check encoding, refusals, features, constraints and experts of a game that has experts.

    Parameters
    ----------
    game : Game
        A small one.
    seed : int, optional
        Of demonstrations.
    """
    require(game.horizon >= 1, f"horizon {game.horizon}: expected at least 1")
    require(0 < game.discount <= 1, f"discount {game.discount}: expected in (0, 1]")
    require(game.digest == game.digest != "", "digest: expected the same text each time")
    names, truth = game.cost_features.names, game.true_constraints
    constraints = np.zeros(len(names), dtype=np.bool_) if truth is None else truth
    require(len(set(names)) == len(names), "cost_features.names: expected all different")
    require(constraints.shape == (len(names),), f"true_constraints: shape {constraints.shape}, expected {len(names)}")
    for kind in game.expert_kinds:
        for demonstration in game.experts(kind, "by_start").demonstrations(DEMONSTRATIONS, np.random.default_rng(seed)):
            _check_encoding(game, demonstration)
            _check_refusals(game, demonstration)
            _check_features(game.cost_features, discounted_visitation(demonstration, game.discount))
            _check_measures(game, demonstration, seed)
    for reward in (game.linear_reward(), *(() if truth is None else (game.true_reward(),))):
        check_reward(reward, game, seed)


def _check_encoding(game: Game, trajectory: Trajectories) -> None:
    states, actions = game.encode(trajectory)
    for name, values in (("states", states), ("actions", actions)):
        expected = f"encode: {name} of shape {values.shape}, expected {game.horizon + 1} rows of finite numbers"
        require(values.ndim == 2 and len(values) == game.horizon + 1 and bool(np.isfinite(values).all()), expected)
    again = game.decode(states, actions)
    same = all(np.array_equal(*pair) for pair in zip(again, trajectory, strict=True))
    require(same, "decode(encode(trajectory)) is another trajectory")


def _check_refusals(game: Game, trajectory: Trajectories) -> None:
    """What is no trajectory of the game is refused with the right error, whatever it is."""
    states, actions = game.encode(trajectory)
    wrong: dict[str, tuple[Array, Array]] = {
        "too short": (states[:1], actions[:1]),
        "too many columns": (np.column_stack([states, states]), actions),
        "not finite": (np.full_like(states, np.nan), actions),
        "out of all bounds": (states + 1e6, actions),
        "one step of which leads elsewhere": (_displaced(states), actions),
    }
    for what, arrays in wrong.items():
        refused = fails(lambda arrays=arrays: game.decode(*arrays), ImpossibleTrajectoryError)  # type: ignore[misc]
        require(refused, f"decode takes a trajectory that is {what}; expected ImpossibleTrajectoryError")


def _check_measures(game: Game, demonstration: Trajectories, seed: int) -> None:
    omega = np.random.default_rng(seed).normal(size=len(game.cost_features.names))
    for measure, values in game.measures(omega, demonstration).items():
        require(measure.isidentifier(), f"measures: {measure!r}, expected a name such as obstacle_cost")
        finite = all(np.isfinite(value) for value in values.values())
        require(finite, f"measures: {measure} is not finite, expected a number for each thing that it measures")


def _displaced(states: Array) -> Array:
    """The states with the last row where the first one was, or elsewhere where nothing has moved."""
    moved = states.copy()
    moved[-1] = states[0] if not np.array_equal(states[0], states[-1]) else states[-1] - 1
    return moved


def _check_features(features: FeatureMap, visitation: Visitation) -> None:
    total = features.total(visitation)
    require(total.shape == (len(features.names),), f"total: shape {total.shape}, expected {len(features.names)}")
    parts = (Visitation(*(values[[k]] for values in visitation)) for k in range(len(visitation.weights)))
    summed = sum((features.total(part) for part in parts), np.zeros(len(features.names)))
    require(np.allclose(total, summed), "total of a visitation: expected the sum of the totals of its pairs")
    twice = features.total(visitation._replace(weights=2 * visitation.weights))
    require(np.allclose(2 * total, twice), "total: expected twice as much for weights twice as large")
    fitting = not getattr(features, "nonnegative", False) or bool((total >= 0).all())
    require(fitting, "total: expected none below 0 of features that say nonnegative = True")
    table = getattr(features, "table", None)
    if table is not None:
        weights = np.random.default_rng(0).normal(size=len(features.names))
        by_table = float(visitation.weights @ table(weights)[visitation.states, visitation.actions])
        require(bool(np.isclose(by_table, weights @ total)), "table and total of the features disagree")
