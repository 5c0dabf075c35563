"""Soft value iteration on a lattice against sums over all joint actions that are written out, and what theory says."""

import math
from itertools import pairwise

import numpy as np
import pytest
from arenas import arena, random_rollouts
from slow_lattice import Model, SlowLattice, log_sum_exp, slow_action_set

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePlanner, LatticePolicy
from mabirds_core.games.drones.rewards import LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.drones.rollouts import SampledDroneOccupancy, drone_rollouts
from mabirds_core.games.drones.stencils import Lattice, action_set
from mabirds_core.games.interface import Trajectories, discounted_visitation

every_size = pytest.mark.parametrize("drones", [1, 2])


def some_parameters(model: Model, scale: float = 1.0, seed: int = 0) -> Parameters:
    rng = np.random.default_rng(seed)
    sizes = model.size, len(model.game.cost_features.names)
    return Parameters(*(scale * rng.normal(size=size) for size in sizes))


def found(model: Model, at: Parameters, spacing: float = 0.8, temperature: float = 1.0) -> LatticePolicy:
    return LatticePlanner(model.game, model, spacing, temperature).plan(*at)


def tiny(drones: int) -> DroneGame:
    """Three steps; the lattice of 0.8 m has 3 times 3 nodes, and actions and goal regions reach some of them."""
    return arena(drones, {"horizon": 2, "max_speed": 2.4, "drones.0.goal_region.radius": 0.4})


def neural(game: DroneGame) -> NeuralDroneReward:
    return NeuralDroneReward(game, hidden=4, bound=5.0)


@every_size
@pytest.mark.parametrize(
    ("make", "scale", "temperature"),
    [
        (LinearDroneReward, 1.0, 1.0),
        (LinearDroneReward, 0.3, 0.1),
        (neural, 1.0, 0.5),
        (TrueDroneReward, 1.0, 0.1),
    ],
)
def test_values_are_those_of_all_joint_actions_summed_up(
    drones: int, make: type[LinearDroneReward], scale: float, temperature: float
) -> None:
    model = make(tiny(drones))
    at = some_parameters(model, scale)
    slow, policy = SlowLattice(model, at, 0.8, temperature), found(model, at, 0.8, temperature)
    np.testing.assert_allclose(policy.values.reshape(slow.values.shape), slow.values, rtol=0, atol=1e-9)
    assert np.ptp(slow.values[0]) > 1


@every_size
@pytest.mark.parametrize(("seed", "distances"), [(1, 1.0), (2, 1.0), (2, 0.01), (3, 0.0)])
def test_values_of_thousands_of_nats_neither_overflow_nor_vanish(drones: int, seed: int, distances: float) -> None:
    """Also where what drones cost each other ranges over more than exp does, or hundreds, or nothing."""
    model = LinearDroneReward(tiny(drones))
    at = some_parameters(model, scale=5000.0, seed=seed)
    at.omega[drones * len(model.game.cost_features.grid.nodes) : -drones] *= distances
    slow, policy = SlowLattice(model, at), found(model, at)
    np.testing.assert_allclose(policy.values.reshape(slow.values.shape), slow.values, rtol=1e-12, atol=1e-8)
    assert np.ptp(slow.values[0]) > 5000


@pytest.mark.parametrize("block", [100, 10**9])
def test_hard_entries_may_be_summed_up_in_blocks(monkeypatch: pytest.MonkeyPatch, block: int) -> None:
    model = LinearDroneReward(tiny(2))
    at = some_parameters(model, scale=5000.0)
    expected = found(model, at).values
    monkeypatch.setattr("mabirds_core.games.drones.lattice.CHUNK", block)
    np.testing.assert_array_equal(found(model, at).values, expected)


def test_easy_entries_are_not_summed_up_one_by_one(monkeypatch: pytest.MonkeyPatch) -> None:
    """The two ways agree, and the slow one is not taken where the fast one will do."""
    model = LinearDroneReward(arena(2))
    at = some_parameters(model)
    fast = found(model, at, 0.4).values
    monkeypatch.setattr("mabirds_core.games.drones.lattice.UNDERFLOW", 1e300)
    slow = found(model, at, 0.4).values
    np.testing.assert_allclose(slow, fast, rtol=0, atol=1e-10)
    monkeypatch.setattr("mabirds_core.games.drones.lattice.UNDERFLOW", 1e-250)
    monkeypatch.setattr("mabirds_core.games.drones.lattice.pair_by_pair", None)
    np.testing.assert_array_equal(found(model, at, 0.4).values, fast)


@every_size
@pytest.mark.parametrize("temperature", [1.0, 0.1])
def test_the_policy_is_that_of_all_joint_actions_at_any_place(drones: int, temperature: float) -> None:
    model = LinearDroneReward(tiny(drones))
    at = some_parameters(model)
    slow, policy = SlowLattice(model, at, 0.8, temperature), found(model, at, 0.8, temperature)
    states = np.random.default_rng(1).uniform(0, np.tile(model.game.arena, drones), size=(8, 2 * drones))
    states[0, :2], states[1, :2], states[2, :2] = (1.3, 1.0), (0.0, 0.0), (1.6, 1.2)  # a goal region and two corners
    for step in range(model.game.horizon + 1):
        scores = policy.log_weights(step, states).reshape(len(states), -1)
        logs = scores - log_sum_exp(scores)[:, None]
        expected = [slow.log_probabilities(step, state) for state in states]
        np.testing.assert_allclose(logs, expected, rtol=0, atol=1e-9)


@every_size
def test_actions_are_drawn_with_the_policys_probabilities(drones: int) -> None:
    model, count = LinearDroneReward(tiny(drones)), 20_000
    policy = found(model, some_parameters(model))
    state = np.array([0.5, 0.4, 1.2, 0.3])[: 2 * drones]
    velocities, _ = action_set(2.4)
    drawn = policy.act(0, np.tile(state, (count, 1)), np.random.default_rng(2)).reshape(count, drones, 2)
    numbers = ((drawn[:, :, None] - velocities) ** 2).sum(axis=-1).argmin(axis=-1)
    np.testing.assert_array_equal(velocities[numbers], drawn)
    weights = np.exp(policy.log_weights(0, state[None]))[0].ravel()
    chances = weights / weights.sum()
    cells = np.ravel_multi_index(tuple(numbers.T), (25,) * drones)
    shares = np.bincount(cells, minlength=chances.size) / count
    spread = np.sqrt(chances * (1 - chances) / count)
    assert (np.abs(shares - chances) <= 5 * spread + 1 / count).all()
    assert chances.max() < 0.5


def test_actions_stand_for_the_uniform_disc() -> None:
    """Shares sum to 1 and have the mean 0; the second moments are within 13 % of v^2 / 4, the mean speed of 2 v / 3."""
    velocities, shares = action_set(2.0)
    expected_velocities, expected_shares = slow_action_set(2.0)
    np.testing.assert_allclose(velocities, expected_velocities, rtol=0, atol=1e-15)
    np.testing.assert_allclose(shares, expected_shares, rtol=0, atol=1e-15)
    assert shares.sum() == pytest.approx(1, abs=1e-15)
    np.testing.assert_allclose(shares @ velocities, 0, atol=1e-15)
    second = (velocities.T * shares) @ velocities
    np.testing.assert_allclose(second, np.eye(2) * 2.0**2 / 4, rtol=0, atol=0.13)
    assert second[0, 0] == pytest.approx(second[1, 1], abs=1e-15)
    assert shares @ np.hypot(*velocities.T) == pytest.approx(2 * 2.0 / 3, rel=0.04)


@every_size
@pytest.mark.parametrize("spacing", [0.1, 0.13, 0.3, 0.8, 1.6])
def test_stencils_weigh_the_nodes_around_what_follows_each_action(drones: int, spacing: float) -> None:
    """Bilinear weights sum to 1 and give back functions that are linear in x, in y and in both."""
    game = arena(drones)
    lattice = Lattice(game, spacing)
    states = np.concatenate([game.starts(20, np.random.default_rng(0)), np.tile(lattice.nodes, (1, drones))])
    places = game.positions(states)
    stencils = lattice.stencils(places)
    assert stencils.weights.min() >= 0
    np.testing.assert_allclose(stencils.weights.sum(axis=-1), 1, rtol=0, atol=1e-12)
    assert stencils.nodes.min() >= 0
    assert stencils.nodes.max() < len(lattice.nodes)
    x, y = np.moveaxis(lattice.nodes, -1, 0)
    for number, velocity in enumerate(lattice.action_set[0]):
        after = game.positions(game.step(states, np.tile(velocity, (len(states), drones))))
        for function in (lambda x, y: 2 * x - 1, lambda x, y: 3 * y, lambda x, y: x * y + x):
            interpolated = (stencils.weights[:, :, number] * function(x, y)[stencils.nodes]).sum(axis=-1)
            np.testing.assert_allclose(interpolated, function(after[..., 0], after[..., 1]), rtol=0, atol=1e-12)


def exchanged(of: Parameters, game: DroneGame) -> Parameters:
    """Of the same game with the drones in the other order."""
    theta = of.theta.reshape(2, -1)[::-1].ravel()
    k = len(game.cost_features.grid.nodes)
    first, second, rest = np.split(of.omega, [k, 2 * k])
    return Parameters(theta, np.concatenate([second, first, rest[:-2], rest[:-3:-1]]))


def test_the_order_of_the_drones_does_not_matter() -> None:
    one = arena(2)
    other = arena(2, {"drones": [task.model_dump() for task in reversed(one.settings.drones)]})
    at = some_parameters(LinearDroneReward(one))
    values = found(LinearDroneReward(one), at, 0.4).values
    swapped = found(LinearDroneReward(other), exchanged(at, one), 0.4).values
    np.testing.assert_allclose(swapped, values.swapaxes(1, 2), rtol=0, atol=1e-10)
    assert np.abs(values - values.swapaxes(1, 2)).max() > 0.1


@every_size
def test_a_temperature_divides_the_reward(drones: int) -> None:
    model = LinearDroneReward(arena(drones))
    at = some_parameters(model)
    cold = found(model, at, 0.4, temperature=0.2)
    large = found(model, Parameters(at.theta / 0.2, at.omega / 0.2), 0.4)
    np.testing.assert_allclose(cold.values, large.values, rtol=0, atol=1e-9)
    states = model.game.starts(5, np.random.default_rng(0))
    np.testing.assert_allclose(cold.log_weights(1, states), large.log_weights(1, states), rtol=0, atol=1e-9)


@every_size
def test_without_rewards_every_value_is_zero_and_actions_have_their_shares(drones: int) -> None:
    model = LinearDroneReward(arena(drones))
    policy = found(model, some_parameters(model, scale=0.0), 0.3)
    np.testing.assert_allclose(policy.values, 0, atol=1e-12)
    _, shares = action_set(1.2)
    expected = np.log(shares)[:, None] + (np.log(shares) if drones == 2 else np.zeros(1))
    found_here = policy.log_weights(0, model.game.starts(1, np.random.default_rng(0)))[0]
    np.testing.assert_allclose(found_here, expected, rtol=0, atol=1e-12)


@every_size
def test_efforts_alone_cost_what_they_do_in_closed_form(drones: int) -> None:
    """V_t = sum_{k <= T - t} gamma^k sum_i log E exp(-w_i 0.3 |a|^2 / v^2), at every place."""
    model = LinearDroneReward(arena(drones))
    at = some_parameters(model, scale=0.0)
    at.omega[-drones:] = [-7.0, -2.0][:drones]
    lengths, shares = np.array([0.0, 0.5, 1.0]), np.array([0.0625, 0.5, 0.4375])
    a_step = sum(math.log(shares @ np.exp(w * 0.3 * lengths**2)) for w in at.omega[-drones:])
    values = found(model, at, 0.4).values
    for step in range(model.game.horizon + 1):
        steps = 0.9 ** np.arange(model.game.horizon + 1 - step)
        np.testing.assert_allclose(values[step], a_step * steps.sum(), rtol=0, atol=1e-12)


@every_size
def test_values_approach_those_of_finer_lattices(drones: int) -> None:
    """At nodes that all lattices share, for rewards and costs that are much wider than their spacings."""
    model = LinearDroneReward(arena(drones, {"features.cost_width": 0.5, "obstacles": []}))
    at = some_parameters(model, seed=4)
    by_spacing = []
    for spacing in (0.4, 0.2, 0.1, 0.05)[: 5 - drones]:
        policy = found(model, at, spacing)
        nodes = policy.lattice.nodes
        shared = [int(np.hypot(*(nodes - place).T).argmin()) for place in ((0.4, 0.4), (0.8, 0.4), (1.2, 0.8))]
        by_spacing.append(policy.values[0][np.ix_(shared, shared if drones == 2 else [0])])
    steps = [float(np.abs(one - other).max()) for one, other in pairwise(by_spacing)]
    assert all(later < 0.6 * earlier for earlier, later in pairwise(steps))
    assert steps[-1] < 0.5


@every_size
def test_a_policy_is_found_and_followed_alike_every_time(drones: int) -> None:
    model = neural(arena(drones))
    at = some_parameters(model)
    one, other = (found(model, at, 0.4) for _ in range(2))
    np.testing.assert_array_equal(one.values, other.values)
    rollouts = [drone_rollouts(model.game, policy, 20, np.random.default_rng(5)) for policy in (one, other)]
    for found_steps, expected in zip(*rollouts, strict=True):
        np.testing.assert_array_equal(found_steps, expected)


@every_size
def test_what_a_planner_found_before_changes_nothing(drones: int) -> None:
    model = LinearDroneReward(arena(drones))
    planner, one, other = (
        LatticePlanner(model.game, model, 0.4, 1.0),
        some_parameters(model),
        some_parameters(model, seed=1),
    )
    states = model.game.starts(5, np.random.default_rng(0))
    first = planner.plan(*one)
    before = first.log_weights(0, states)
    planner.plan(*other)
    np.testing.assert_array_equal(planner.plan(*one).values, first.values)
    np.testing.assert_array_equal(first.log_weights(0, states), before)
    np.testing.assert_array_equal(found(model, other, 0.4).values, planner.plan(*other).values)


def test_a_planner_remembers_nothing() -> None:
    model = LinearDroneReward(arena(2))
    planner = LatticePlanner(model.game, model, 0.8, 1.0)
    assert planner.state_dict(planner.plan(*some_parameters(model))) == {}
    assert planner.load_state_dict({}) is None


@every_size
def test_drones_avoid_what_costs_and_seek_what_pays(drones: int) -> None:
    game = arena(drones, {"horizon": 10})
    model = TrueDroneReward(game)
    constraints = -1.0 * game.true_constraints
    careful, careless = (
        drone_rollouts(
            game, found(model, Parameters(np.zeros(0), omega), 0.1, temperature=0.03), 300, np.random.default_rng(6)
        )
        for omega in (constraints, 0 * constraints)
    )
    assert game.succeeds(careful).mean() > 0.95
    assert game.violates(careless).mean() > 0.95
    assert game.arrived(careless.states[:, -1]).mean() > 0.95
    assert game.arrived(random_rollouts(game, 300).states[:, -1]).mean() < 0.1


def per_rollout(model: Model, theta: Vector, rollouts: Trajectories) -> Array:
    """grad J and mu of every rollout, shape (m, K)."""
    game = model.game
    rows = []
    for states, actions in zip(*rollouts, strict=True):
        one = discounted_visitation(Trajectories(states[None], actions[None]), game.discount)
        rows.append(np.concatenate([model.gradient(theta, one), game.cost_features.total(one)]))
    return np.array(rows)


@every_size
@pytest.mark.parametrize("make", [LinearDroneReward, neural], ids=["linear", "neural"])
def test_the_gradient_is_zero_in_the_mean_for_demonstrations_of_the_policy_itself(
    drones: int, make: type[LinearDroneReward]
) -> None:
    """Within 4.5 standard errors of 2 x 600 rollouts in each entry; for demonstrations of others it is not."""
    model, count = make(arena(drones)), 600
    game, at = model.game, some_parameters(model)
    planner = LatticePlanner(game, model, 0.4, 1.0)
    estimator = GradientEstimator(game, model, planner, SampledDroneOccupancy(game, count), "initial")
    own = drone_rollouts(game, planner.plan(*at), count, np.random.default_rng(8))
    error = per_rollout(model, at.theta, own).std(axis=0) * np.sqrt(2 / count) + 1e-9
    gradient = estimator(at, estimator.window(1).add(own), np.random.default_rng(9)).gradient
    assert (np.abs(np.concatenate(gradient)) < 4.5 * error).all()
    foreign = drone_rollouts(game, planner.plan(-at.theta, -at.omega), count, np.random.default_rng(8))
    gradient = estimator(at, estimator.window(1).add(foreign), np.random.default_rng(9)).gradient
    assert (np.abs(np.concatenate(gradient)) > 4.5 * error).mean() > 0.3
