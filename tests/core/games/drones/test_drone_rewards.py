"""Reward models of the drone game: gradients against finite differences, bounds, what they are made of."""

from collections.abc import Callable

import numpy as np
import pytest
from arenas import arena, double, random_rollouts
from games import central_differences

from mabirds_core.arrays import Vector
from mabirds_core.games.drones.arrival import ArrivingDroneReward, ArrivingNeuralDroneReward
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.rewards import DroneRewardModel, LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.interface import Visitation, discounted_visitation

BOUND = 3.0


def neural(game: DroneGame) -> NeuralDroneReward:
    return NeuralDroneReward(game, hidden=4, bound=BOUND)


def arriving(game: DroneGame) -> ArrivingNeuralDroneReward:
    return ArrivingNeuralDroneReward(game, hidden=4, bound=BOUND)


Make = Callable[[DroneGame], DroneRewardModel]
every_game = pytest.mark.parametrize("game", [arena(1), arena(2), arena(3), double(2)], ids=["1", "2", "3", "double"])
every_model = pytest.mark.parametrize(
    "make", [LinearDroneReward, neural, arriving], ids=["linear", "neural", "arriving"]
)


def visitation_of(game: DroneGame, rollouts: int = 6) -> Visitation:
    return discounted_visitation(random_rollouts(game, rollouts), game.discount)


def some_theta(of: DroneRewardModel, seed: int = 0, scale: float = 1.0) -> Vector:
    return np.random.default_rng(seed).normal(size=of.size) * scale


def weighted_reward(model: DroneRewardModel, game: DroneGame, theta: Vector, over: Visitation) -> float:
    """sum_k weights[k] r_theta(states[k], actions[k])."""
    return float(over.weights @ total_reward(game.space, model, theta, over.states, over.actions))


@every_game
@every_model
@pytest.mark.parametrize(("seed", "scale"), [(0, 0.1), (1, 1.0), (2, 3.0)])
def test_the_gradient_is_that_of_finite_differences(game: DroneGame, make: Make, seed: int, scale: float) -> None:
    model, over = make(game), visitation_of(game)
    theta = some_theta(model, seed, scale)
    found = model.gradient(theta, over)
    expected = central_differences(lambda at: weighted_reward(model, game, at, over), theta)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-8)
    assert found.dtype == np.float64
    assert np.abs(found).max() > 0.05


@every_model
def test_a_gradient_leaves_its_arguments_and_takes_those_that_cannot_be_written_to(make: Make) -> None:
    """As messages and the weights of a single trajectory are; torch would warn, which is an error here."""
    game = arena(2)
    model, over = make(game), visitation_of(game, rollouts=1)
    theta = some_theta(model)
    expected, before = model.gradient(theta.copy(), over), theta.copy()
    theta.flags.writeable = False
    np.testing.assert_array_equal(model.gradient(theta, over), expected)
    np.testing.assert_array_equal(theta, before)


@every_game
@every_model
def test_terms_of_the_drones_add_up_to_the_reward_that_has_the_gradient(game: DroneGame, make: Make) -> None:
    """Linear rewards are theta^T grad; a neural one is the integral of its gradient along theta, outputs first."""
    model, over = make(game), visitation_of(game)
    theta = some_theta(model)
    shares = (np.arange(400) + 0.5) / 400
    along = np.mean([theta @ model.gradient(share * theta, over) for share in shares])
    assert along == pytest.approx(weighted_reward(model, game, theta, over), abs=1e-4)


@every_game
@every_model
def test_every_reward_is_zero_at_first(game: DroneGame, make: Make) -> None:
    model, over = make(game), visitation_of(game)
    theta = model.initial(np.random.default_rng(7))
    assert theta.shape == (model.size,)
    assert not total_reward(game.space, model, theta, over.states, over.actions).any()
    assert not model.gradient(theta, over)[theta != 0].any()


@every_model
def test_the_first_parameters_are_those_of_the_seed(make: Make) -> None:
    model = make(arena(2))
    one, same = (model.initial(np.random.default_rng(3)) for _ in range(2))
    np.testing.assert_array_equal(one, same)


def test_a_neural_reward_can_leave_zero() -> None:
    game = arena(2)
    model = neural(game)
    theta = model.initial(np.random.default_rng(0))
    assert np.abs(model.gradient(theta, visitation_of(game))).max() > 0.05


@every_game
@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0, 1e6])
def test_a_neural_reward_is_bounded_for_every_theta(game: DroneGame, scale: float) -> None:
    model, over = neural(game), visitation_of(game)
    for seed in range(5):
        theta = some_theta(model, seed, scale)
        assert np.abs(total_reward(game.space, model, theta, over.states, over.actions)).max() <= BOUND * (1 + 1e-15)
        assert np.isfinite(model.gradient(theta, over)).all()


def test_a_neural_reward_is_that_of_its_formula() -> None:
    """C / N_E tanh( sum_h tanh(v_h) tanh(U_h x + b_h) ), unit by unit."""
    game = arena(2)
    model = neural(game)
    theta = some_theta(model, scale=2)
    states = np.array([[0.2, 1.1], [1.4, 0.3], [0.0, 0.0]])
    for drone in range(2):
        parts = theta.reshape(2, 4, 4)[drone]
        found = model.unary(theta, drone, states, np.zeros((3, 2)))
        for value, (x, y) in zip(found, states, strict=True):
            inputs = 2 * x / 1.6 - 1, 2 * y / 1.2 - 1
            total = sum(
                np.tanh(v) * np.tanh(u_x * inputs[0] + u_y * inputs[1] + b)
                for u_x, u_y, b, v in zip(*parts, strict=True)
            )
            assert value == pytest.approx(BOUND / 2 * np.tanh(total), abs=1e-12)


@every_game
def test_networks_say_of_lateness_what_linear_rewards_do(game: DroneGame) -> None:
    """Beside networks that say nothing as beside weights of 0: the same reward, and the same counts for its steps."""
    networks, linear, over = arriving(game), ArrivingDroneReward(game), visitation_of(game)
    late = np.random.default_rng(5).normal(size=game.n_experts)
    ours, theirs = (of.initial(np.random.default_rng(0)) for of in (networks, linear))
    ours[networks.counts], theirs[linear.counts] = late, late
    assert weighted_reward(networks, game, ours, over) == weighted_reward(linear, game, theirs, over) != 0
    np.testing.assert_array_equal(
        networks.gradient(ours, over)[networks.counts], linear.gradient(theirs, over)[linear.counts]
    )
    assert [networks.arriving(ours, i) for i in range(len(late))] == [
        linear.arriving(theirs, i) for i in range(len(late))
    ]


@every_game
def test_linear_rewards_weigh_the_reward_features(game: DroneGame) -> None:
    model, over = LinearDroneReward(game), visitation_of(game)
    theta = some_theta(model)
    features = game.reward_features.total(over)
    np.testing.assert_array_equal(model.gradient(theta, over), features)
    assert theta @ features == pytest.approx(weighted_reward(model, game, theta, over), abs=1e-12)


def test_the_true_reward_counts_the_drones_under_way() -> None:
    """Goal regions at (1.3, 1.0) with 0.2 m and (0.2, 0.9) with 0.25 m; 0.5 a step for each drone that is not there."""
    game = arena(2)
    states = np.array([[0.3, 0.3, 1.3, 0.2], [1.3, 1.0, 1.3, 0.2], [0.3, 0.3, 0.2, 0.66], [1.3, 0.81, 0.2, 0.9]])
    found = total_reward(game.space, TrueDroneReward(game), np.zeros(0), states, np.ones((4, 4)))
    assert found.tolist() == [-1.0, -0.5, -0.5, 0.0]


@every_game
def test_the_true_reward_has_no_parameters(game: DroneGame) -> None:
    model, over = TrueDroneReward(game), visitation_of(game)
    assert model.size == 0
    assert model.initial(np.random.default_rng(0)).shape == model.gradient(np.zeros(0), over).shape == (0,)
    arrived = game.arrived(over.states)
    found = total_reward(game.space, model, np.zeros(0), over.states, over.actions)
    np.testing.assert_allclose(found, -0.5 * (~arrived).sum(axis=1), rtol=0, atol=1e-15)


@pytest.mark.parametrize("make", [LinearDroneReward, neural, TrueDroneReward], ids=["linear", "neural", "true"])
def test_no_reward_model_has_terms_of_pairs(make: Make) -> None:
    model, distances = make(arena(2)), np.array([[0.0, 0.1], [0.5, 2.0]])
    found = model.pairwise(some_theta(model), 0, distances)
    assert found.shape == distances.shape
    assert not found.any()
