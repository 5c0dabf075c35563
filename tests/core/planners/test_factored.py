"""Policies found one expert after the other against the readable reference, which knows of no experts."""

import numpy as np
import pytest
from games import alone, crossing_diagonals, doors, hallway, patrol, square, trio

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.kernels.factored import Totals
from mabirds_core.kernels.loading import library
from mabirds_core.planners.factored import FactoredPolicy, FactoredVisitation, factored_policy, factored_reward
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, pairs_of
from mabirds_core.planners.soft_bellman import SoftBellmanPolicy, soft_bellman_policy
from mabirds_core.rewards.models import LinearReward

pytestmark = pytest.mark.skipif(library() is None, reason="kernels are not compiled")

FOUR = patrol("..\n..", [((0, 0), (0, 1), (1, 0), (1, 1))], ((1, 1), (1, 0), (0, 1), (0, 0)), horizon=4)
GAMES = {
    "one expert": alone(),
    "a square": square(horizon=9),
    "a hallway": hallway(horizon=12),
    "a room": patrol("....\n....\n.#..\n....\n....", [((0, 0), (4, 3))], ((4, 3), (0, 0)), 20, 0.95),
    "a field": patrol("\n".join(["." * 9] * 8), [((0, 0), (7, 8))], ((7, 8), (0, 0)), 12, 1.0),
    "three experts": trio(),
    "three in a room": patrol("...\n...\n...", [((0, 0), (0, 2), (2, 0))], ((2, 2), (2, 0), (0, 0)), 8, 0.9),
    "four experts": FOUR,
    "doors": doors(horizon=8),
    "diagonals": crossing_diagonals(),
    "three who wait": patrol("..\n..", [((0, 0), (0, 1), (1, 0))], ((1, 1), (1, 0), (0, 1)), 5, waiting=True),
    "a hall with exits": patrol(
        "\n".join(["......"] * 4),
        [((0, 0), (3, 5))],
        [((0, 5), (1, 5), (2, 5), (3, 5)), ((0, 0), (1, 0))],
        15,
        waiting=True,
        diagonals=True,
        leaving=True,
    ),
}
BLOCK = patrol("\n".join(["....."] * 5), [((0, 0), (4, 4), (0, 4))], ((4, 4), (0, 0), (4, 0)), 3, 0.95)
every_game = pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)
WEIGHTS = [
    (1.0, -3.0),
    (1.0, 0.0),
    (1.0, -1e4),
    (1.0, 20.0),
    (1.0, 2000.0),
    (300.0, -3.0),
    (300.0, -500.0),
    (1e4, -1e4),
]
"""Size of the weights, and what sharing and swapping weigh: nats."""
all_weights = pytest.mark.parametrize(("scale", "joint"), WEIGHTS)


def weights(game: PatrolGame, scale: float, joint: float, seed: int = 0) -> tuple[Vector, Vector]:
    rng = np.random.default_rng(seed)
    theta = scale * rng.normal(size=len(game.reward_features.names))
    omega = -scale * rng.exponential(size=len(game.cost_features.names))
    omega[-2:] = joint * np.array([1.0, 0.7])
    return theta, omega


def fast(game: PatrolGame, theta: Vector, omega: Vector) -> FactoredPolicy:
    reward = factored_reward(LinearReward(game.reward_features), game.cost_features, theta, omega)
    assert reward is not None
    return factored_policy(game, reward)


def slow(game: PatrolGame, theta: Vector, omega: Vector) -> SoftBellmanPolicy:
    return soft_bellman_policy(game, game.reward_features.table(theta) + game.cost_features.table(omega))


def counts(game: PatrolGame, policy: SoftBellmanPolicy) -> Array:
    return discounted_steps(game) * occupancy_measure(game, policy)


@every_game
@all_weights
def test_values_and_chances(game: PatrolGame, scale: float, joint: float) -> None:
    found, expected = (solve(game, *weights(game, scale, joint)) for solve in (fast, slow))
    largest = np.abs(expected.values).max()
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-13, atol=1e-13 * largest)
    everywhere = np.arange(game.n_states)
    for step in (0, game.horizon // 2, game.horizon):
        ours, theirs = (np.exp(policy.log_probabilities(step, everywhere)) for policy in (found, expected))
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-14 * max(1.0, largest))
        np.testing.assert_allclose(ours.sum(axis=1), 1, rtol=0, atol=1e-14 * max(1.0, largest))


@every_game
@all_weights
def test_where_it_goes(game: PatrolGame, scale: float, joint: float) -> None:
    theta, omega = weights(game, scale, joint)
    visitation, expected = (
        fast(game, theta, omega).visitation(game.initial_distribution),
        counts(game, slow(game, theta, omega)),
    )
    assert isinstance(visitation, FactoredVisitation)
    pairs = pairs_of(expected)
    np.testing.assert_allclose(visitation.totals.states, expected.sum(axis=1), rtol=0, atol=1e-10)
    for features in (game.cost_features, game.reward_features):
        np.testing.assert_allclose(features.total(visitation), features.total(pairs), rtol=0, atol=1e-10)


@every_game
def test_written_out_it_is_the_same_visitation(game: PatrolGame) -> None:
    theta, omega = weights(game, 1.0, -2.0)
    visitation, expected = (
        fast(game, theta, omega).visitation(game.initial_distribution),
        counts(game, slow(game, theta, omega)),
    )
    found = np.zeros_like(expected)
    states, actions, of_pair = visitation
    np.add.at(found, (states, actions), of_pair)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@every_game
@pytest.mark.parametrize("joint", [-1.0, 1.5])
def test_expectations_are_the_gradient_of_the_value(game: PatrolGame, joint: float) -> None:
    theta, omega = weights(game, 1.0, joint)
    visitation = fast(game, theta, omega).visitation(game.initial_distribution)
    rng, step = np.random.default_rng(1), 1e-5

    def value(along: float) -> float:
        return float(
            game.initial_distribution @ fast(game, theta + along * by_theta, omega + along * by_omega).values[0]
        )

    for _ in range(3):
        by_theta, by_omega = rng.normal(size=len(theta)), rng.normal(size=len(omega))
        slope = by_theta @ game.reward_features.total(visitation) + by_omega @ game.cost_features.total(visitation)
        assert slope == pytest.approx((value(step) - value(-step)) / (2 * step), abs=1e-7)


@every_game
@all_weights
def test_probability_of_touching_nothing(game: PatrolGame, scale: float, joint: float) -> None:
    theta, omega = weights(game, scale, joint)
    policy, rng = fast(game, theta, omega), np.random.default_rng(2)
    kept = Totals(*(1.0 * (rng.random(part.shape) < 0.8) for part in policy.reward))
    kept.levels[0] = 1.0
    assert policy.remaining(kept) == pytest.approx(_remaining(game, slow(game, theta, omega), kept), abs=1e-10)


def _remaining(game: PatrolGame, policy: SoftBellmanPolicy, kept: Totals) -> float:
    everywhere, actions = np.arange(game.n_states), np.arange(game.n_actions)
    clean = kept.states[:, None] * kept.levels[game.swapping]
    for of_expert, cells, moves in zip(kept.moves, game.cells(everywhere), game.moves(actions), strict=True):
        clean = clean * of_expert[cells[:, None], moves]
    present = game.initial_distribution
    for step in range(game.horizon + 1):
        pairs = present[:, None] * np.exp(policy.log_probabilities(step, everywhere)) * clean
        present = np.bincount(game.successor.ravel(), pairs.ravel(), minlength=game.n_states)
    return float(present.sum())


def test_more_states_than_numpy_takes_at_a_time() -> None:
    theta, omega = weights(BLOCK, 2.0, -5.0)
    found, expected = (solve(BLOCK, theta, omega) for solve in (fast, slow))
    np.testing.assert_allclose(found.values, expected.values, rtol=1e-13, atol=1e-12)
    everywhere = np.arange(BLOCK.n_states)
    np.testing.assert_allclose(*(policy.log_probabilities(1, everywhere) for policy in (found, expected)), atol=1e-11)


@pytest.mark.parametrize("game", [*GAMES.values(), BLOCK], ids=[*GAMES, "three on a block"])
def test_levels_are_the_pairs_that_swap(game: PatrolGame) -> None:
    np.testing.assert_array_equal(game.factors.levels(np.arange(game.n_states)), game.swapping)


def test_a_start_that_is_given_is_where_it_starts() -> None:
    game = GAMES["a room"]
    start = np.zeros(game.n_states)
    start[[7, 200]] = 0.5
    theta, omega = weights(game, 1.0, -1.0)
    visitation = fast(game, theta, omega).visitation(start)
    expected = discounted_steps(game) * occupancy_measure(game, slow(game, theta, omega), np.array([7, 200]))
    assert isinstance(visitation, FactoredVisitation)
    np.testing.assert_allclose(visitation.totals.states, expected.sum(axis=1), rtol=0, atol=1e-12)
