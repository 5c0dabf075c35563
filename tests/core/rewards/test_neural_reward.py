"""The neural reward: its gradient against finite differences, and the bounds of Assumption 1."""

import numpy as np
import pytest
from experiments import demonstrations, experiment
from games import alone, central_differences, hallway, random_policy, trio

from mabirds_core.arrays import Array, Vector
from mabirds_core.experiment.assembly import build_game, build_learner, evaluation_policy
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.interface import Visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.metrics.metrics import exact_imitation
from mabirds_core.planners.occupancy import ExactOccupancy
from mabirds_core.rewards.models import NeuralReward


def model(game: PatrolGame, hidden: int = 5, bound: float = 3.0) -> NeuralReward:
    return NeuralReward(game.reward_features, hidden, bound, game.n_experts)


def some_theta(of: NeuralReward, seed: int = 0, scale: float = 1.0) -> Vector:
    return np.random.default_rng(seed).normal(size=of.size) * scale


def naive_reward(of: NeuralReward, theta: Vector, x: Vector) -> float:
    """C / N_E tanh( sum_h tanh(v_h) tanh(U_h x + b_h) ), unit by unit."""
    d = len(x)
    total = 0.0
    for h in range(of.hidden):
        u, b, v = theta[h * d : (h + 1) * d], theta[of.hidden * d + h], theta[of.hidden * (d + 1) + h]
        total += np.tanh(v) * np.tanh(u @ x + b)
    return float(of.bound / of.n_experts * np.tanh(total))


def test_weights_are_those_of_the_formula() -> None:
    reward = model(hallway())
    theta = some_theta(reward)
    expected = [naive_reward(reward, theta, x) for x in hallway().reward_features.descriptors]
    np.testing.assert_allclose(reward.weights(theta), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("make", [alone, hallway, trio])
def test_descriptors_tell_all_features_apart_and_stay_in_their_range(make: object) -> None:
    features = make().reward_features  # type: ignore[operator]
    x = features.descriptors
    assert len(np.unique(x, axis=0)) == len(features.names) == len(x)
    assert np.abs(x).max() == 1.0


def test_the_gradient_of_a_visitation_is_that_of_finite_differences() -> None:
    game = hallway()
    reward = model(game)
    rng = np.random.default_rng(1)
    visitation = ExactOccupancy(game)(random_policy(game, rng), rng)
    theta = some_theta(reward)

    def total(at: Vector) -> float:
        return float(visitation.weights @ reward.table(at)[visitation.states, visitation.actions])

    found = reward.gradient(theta, visitation)
    np.testing.assert_allclose(found, central_differences(total, theta), rtol=0, atol=1e-7)
    assert np.abs(found).max() > 0.1


@pytest.mark.parametrize("scale", [0.1, 1.0, 30.0, 1e6])
def test_the_reward_and_its_gradient_are_bounded_for_every_theta(scale: float) -> None:
    game, bound = hallway(), 3.0
    reward = model(game, bound=bound)
    for seed in range(5):
        theta = some_theta(reward, seed, scale)
        assert np.abs(reward.table(theta)).max() <= bound
        for pair in ((0, 0), (7, 3), (20, 15)):
            assert np.abs(pair_gradient(reward, theta, *pair)).max() <= bound


def pair_gradient(reward: NeuralReward, theta: Vector, state: int, action: int) -> Vector:
    return reward.gradient(theta, Visitation(np.array([state]), np.array([action]), np.ones(1)))


def hessian(reward: NeuralReward, theta: Vector, width: float = 1e-5) -> Array:
    units = np.eye(reward.size) * width
    rows = [
        (pair_gradient(reward, theta + unit, 7, 3) - pair_gradient(reward, theta - unit, 7, 3)) / (2 * width)
        for unit in units
    ]
    return np.array(rows)


@pytest.mark.parametrize("scale", [0.1, 1.0, 10.0])
def test_the_hessian_is_symmetric_and_bounded(scale: float) -> None:
    reward = model(hallway())
    for seed in range(3):
        found = hessian(reward, some_theta(reward, seed, scale))
        np.testing.assert_allclose(found, found.T, rtol=0, atol=1e-7)
        assert np.abs(found).max() <= 2 * reward.bound


def test_every_seed_begins_with_a_reward_of_zero_from_which_it_can_move() -> None:
    reward = model(hallway())
    one, other = (reward.initial(np.random.default_rng(seed)) for seed in (0, 1))
    assert not np.array_equal(one, other)
    for theta in (one, other):
        assert not reward.table(theta).any()
        assert pair_gradient(reward, theta, 7, 3).any()


def test_learners_with_a_neural_reward_begin_alike_and_learn() -> None:
    changes = {
        "algorithm.reward": {"kind": "neural", "hidden": 8, "bound": 5.0},
        "algorithm.expectation": "exact",
        "algorithm.steps": {"alpha": 8.0, "beta": 1.0},
        "game.horizon": 8,
    }
    settings = experiment(changes)
    ann, bob = (build_learner(settings, name).initial_state().parameters for name in ("ann", "bob"))
    np.testing.assert_array_equal(ann.theta, bob.theta)
    history = simulate(settings, demonstrations(settings))["ann"]
    game = build_game(settings)
    policy = evaluation_policy(settings, "ann", game)
    first, last = (exact_imitation(game, policy(history[n])).violation_rate for n in (0, -1))
    assert np.abs(history[-1].theta - history[0].theta).max() > 0.1
    assert first > 0.9
    assert last < 0.01
