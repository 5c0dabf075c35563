"""Rollouts and the exact occupancy measure against enumeration of every trajectory of tiny games."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from games import (
    TablePolicy,
    all_trajectories,
    discounted_sums,
    hallway,
    one,
    probabilities,
    random_policy,
    square,
)

from mabirds_core.arrays import Array, Vector
from mabirds_core.errors import InfeasibleError
from mabirds_core.games.interface import FeatureMap, TabularGame, Trajectories, discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.occupancy import (
    ExactOccupancy,
    SampledOccupancy,
    discounted_steps,
    occupancy_measure,
    rollouts,
)
from mabirds_core.planners.soft_bellman import SoftBellmanPolicy, soft_bellman_policy

FEATURES: list[Callable[[PatrolGame], FeatureMap]] = [lambda g: g.cost_features, lambda g: g.reward_features]
both_features = pytest.mark.parametrize("features", FEATURES, ids=["cost", "reward"])


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def constrained_policy(game: TabularGame) -> SoftBellmanPolicy:
    """A soft policy of a random reward that never breaks a true constraint."""
    reward = rng(1).normal(size=(game.n_states, game.n_actions))
    return soft_bellman_policy(game, np.where(game.violation, -np.inf, reward))


def blocked_policy(game: TabularGame) -> SoftBellmanPolicy:
    """A policy with no action to take anywhere."""
    return soft_bellman_policy(game, np.full((game.n_states, game.n_actions), -np.inf))


def totals(features: FeatureMap, game: TabularGame, trajectories: Trajectories) -> Array:
    """sum_t gamma^t f(s_t, a_t) of every trajectory, shape (m, K)."""
    singles = (one(trajectories, number) for number in range(len(trajectories.states)))
    return np.array([features.total(discounted_visitation(single, game.discount)) for single in singles])


def enumerated_occupancy(game: TabularGame, trajectories: Trajectories, chances: Vector) -> Array:
    """sum_t gamma^t P(s_t = s, a_t = a), shape (S, A), trajectory by trajectory."""
    occupancy = np.zeros((game.n_states, game.n_actions))
    for states, actions, chance in zip(*trajectories, chances, strict=True):
        for step, (state, action) in enumerate(zip(states, actions, strict=True)):
            occupancy[state, action] += chance * game.discount**step
    return occupancy


class ConstantDraws(np.random.Generator):
    """A generator whose uniform numbers all have one value."""

    def __init__(self, value: float) -> None:
        super().__init__(np.random.PCG64(0))
        self._value = value

    def random(self, size: Any = None, *_: Any, **__: Any) -> Any:
        return np.full(size, self._value)


@pytest.mark.parametrize("game", [square(), hallway(), hallway(discount=1)], ids=["2x2", "2x3", "gamma 1"])
def test_occupancy_has_mass_one(game: PatrolGame) -> None:
    for policy in (random_policy(game, rng()), constrained_policy(game)):
        assert occupancy_measure(game, policy).sum() == pytest.approx(1, abs=1e-12)


@pytest.mark.parametrize("game", [square(), hallway()], ids=["square", "hallway"])
def test_occupancy_is_the_discounted_frequency_over_all_trajectories(game: PatrolGame) -> None:
    policy, trajectories = random_policy(game, rng()), all_trajectories(game)
    expected = enumerated_occupancy(game, trajectories, probabilities(game, policy, trajectories))
    found = occupancy_measure(game, policy)
    np.testing.assert_allclose(found * discounted_steps(game), expected, rtol=0, atol=1e-13)


def test_discounted_steps_is_the_sum_of_the_powers_of_gamma() -> None:
    assert discounted_steps(hallway(discount=0.5, horizon=3)) == 1 + 0.5 + 0.25 + 0.125
    assert discounted_steps(hallway(discount=1, horizon=3)) == 4


def test_occupancy_of_a_constrained_policy_never_touches_a_constraint() -> None:
    game = hallway()
    assert not occupancy_measure(game, constrained_policy(game))[game.violation].any()


@both_features
def test_exact_totals_of_features_are_their_mean_over_all_trajectories(
    features: Callable[[PatrolGame], FeatureMap],
) -> None:
    game = hallway()
    policy, trajectories = random_policy(game, rng()), all_trajectories(game)
    exact = features(game).total(ExactOccupancy(game)(policy, rng()))
    expected = probabilities(game, policy, trajectories) @ totals(features(game), game, trajectories)
    np.testing.assert_allclose(exact, expected, rtol=0, atol=1e-12)


def test_the_exact_visitation_lists_each_possible_pair_once() -> None:
    game = hallway()
    visitation = ExactOccupancy(game)(constrained_policy(game), rng())
    pairs = list(zip(visitation.states.tolist(), visitation.actions.tolist(), strict=True))
    assert len(pairs) == len(set(pairs)) < game.n_states * game.n_actions
    assert (visitation.weights > 0).all()


def test_rollouts_obey_the_dynamics_and_start_where_the_game_does() -> None:
    game = hallway(horizon=6)
    states, actions = rollouts(game, random_policy(game, rng()), 50, rng())
    assert states.shape == actions.shape == (50, 7)
    assert (game.initial_distribution[states[:, 0]] > 0).all()
    np.testing.assert_array_equal(states[:, 1:], game.successor[states[:, :-1], actions[:, :-1]])


def test_rollouts_of_a_constrained_policy_break_no_constraint() -> None:
    game = hallway(horizon=6)
    states, actions = rollouts(game, constrained_policy(game), 200, rng())
    assert not game.violation[states, actions].any()


@both_features
def test_means_over_many_rollouts_approach_the_exact_totals(
    features: Callable[[PatrolGame], FeatureMap],
) -> None:
    game, count = hallway(horizon=4), 4000
    policy = constrained_policy(game)
    drawn = totals(features(game), game, rollouts(game, policy, count, rng(5)))
    exact = features(game).total(ExactOccupancy(game)(policy, rng()))
    standard_error = drawn.std(axis=0, ddof=1) / np.sqrt(count)
    assert (np.abs(drawn.mean(axis=0) - exact) <= 4.5 * standard_error + 1e-12).all()
    assert (standard_error > 0).sum() > 5


def test_rollouts_start_with_the_frequencies_of_the_initial_distribution() -> None:
    game, count = hallway(), 10_000
    starts = rollouts(game, random_policy(game, rng()), count, rng(6)).states[:, 0]
    shares = np.bincount(starts, minlength=game.n_states) / count
    chances = game.initial_distribution
    assert (np.abs(shares - chances) <= 4.5 * np.sqrt(chances * (1 - chances) / count)).all()


@both_features
def test_a_sampled_total_is_the_mean_over_its_rollouts(features: Callable[[PatrolGame], FeatureMap]) -> None:
    game = hallway()
    policy = random_policy(game, rng())
    sampled = features(game).total(SampledOccupancy(game, 30)(policy, rng(7)))
    expected = totals(features(game), game, rollouts(game, policy, 30, rng(7))).mean(axis=0)
    np.testing.assert_allclose(sampled, expected, rtol=0, atol=1e-12)


def test_the_same_seed_gives_the_same_rollouts_and_another_seed_others() -> None:
    game = hallway()
    policy = random_policy(game, rng())
    first, again, other = (rollouts(game, policy, 20, rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(first.actions, again.actions)
    np.testing.assert_array_equal(first.states, again.states)
    assert (first.actions != other.actions).any()


@pytest.mark.parametrize("mass", [1.0, 1 - 1e-9, 1 + 1e-9])
@pytest.mark.parametrize("draw", [0.0, 0.25, 0.5, np.nextafter(1, 0)])
def test_no_draw_and_no_rounding_picks_an_action_of_probability_zero(draw: float, mass: float) -> None:
    game = hallway()
    chances = np.zeros((game.horizon + 1, game.n_states, game.n_actions))
    chances[..., [3, 5, 9, 14]] = mass * np.array([0.1, 0.4, 0.3, 0.2])
    actions = rollouts(game, TablePolicy(chances), 3, ConstantDraws(draw)).actions
    assert set(actions.ravel()) == {{0.0: 3, 0.25: 5, 0.5: 9}.get(draw, 14)}


def test_rollouts_of_a_game_in_which_all_is_blocked_are_infeasible() -> None:
    game = square()
    with pytest.raises(InfeasibleError, match="every action is blocked"):
        rollouts(game, blocked_policy(game), 3, rng())


def test_rollouts_into_a_dead_end_are_infeasible() -> None:
    game = square()
    chances = np.full((game.horizon + 1, game.n_states, game.n_actions), 1 / game.n_actions)
    chances[1:] = 0
    with pytest.raises(InfeasibleError):
        rollouts(game, TablePolicy(chances), 3, rng())


def test_the_exact_expectation_of_a_game_in_which_all_is_blocked_is_infeasible_too() -> None:
    """A visitation of no pairs would pass for an expectation of zero: rollouts refuse the same policy."""
    game = square()
    with pytest.raises(InfeasibleError):
        ExactOccupancy(game)(blocked_policy(game), rng())


def test_discounted_visitation_of_two_trajectories_by_hand() -> None:
    two = Trajectories(np.array([[1, 2], [3, 4]]), np.array([[5, 6], [7, 8]]))
    visitation = discounted_visitation(two, 0.5)
    np.testing.assert_array_equal(visitation.states, [1, 2, 3, 4])
    np.testing.assert_array_equal(visitation.actions, [5, 6, 7, 8])
    np.testing.assert_array_equal(visitation.weights, [0.5, 0.25, 0.5, 0.25])


def test_weights_of_a_visitation_sum_to_the_discounted_steps() -> None:
    game = hallway()
    policy = constrained_policy(game)
    for expectation in (ExactOccupancy(game), SampledOccupancy(game, 7)):
        assert expectation(policy, rng()).weights.sum() == pytest.approx(discounted_steps(game), abs=1e-12)


def test_discounted_sums_weigh_step_t_by_gamma_to_the_t() -> None:
    """The enumerations of this suite rest on this helper."""
    game = hallway(discount=0.5)
    np.testing.assert_array_equal(discounted_sums(game, np.array([[1.0, 1.0, 4.0]])), [2.5])
