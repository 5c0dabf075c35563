"""Networks as costs: the formula by loops, the whole loss's gradient against torch, the penalty as a projection."""

from itertools import combinations
from math import dist, inf
from typing import Any

import numpy as np
import pytest
import torch
from games import SlowPatrol, central_differences, doors, hallway, slippery, trio
from network_costs import some_omega, with_network

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.memory import Memory, RunningMean, WindowMemory
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.costs.network import NetworkCost, StateRewards
from mabirds_core.games.interface import TabularFeatureMap, Trajectories, discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.factored import FactoredPolicy
from mabirds_core.planners.occupancy import ExactOccupancy, rollouts
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner, soft_bellman_policy


def shown(game: PatrolGame, count: int = 4) -> Trajectories:
    uniform = soft_bellman_policy(game, np.zeros((game.n_states, game.n_actions)))
    return rollouts(game, uniform, count, np.random.default_rng(5))


def naive_inputs(game: PatrolGame) -> Array:
    """Row, column (and presence) of each expert, then distance and nearness of pairs, joint state by joint state."""
    rules, (height, width), rows = SlowPatrol(game.settings), (game.height - 1, game.width - 1), []
    leaving = game.settings.leaving
    for state in rules.states:
        row = list[float]()
        for i, (r, c) in enumerate(state):
            row += [2 * r / max(height, 1) - 1, 2 * c / max(width, 1) - 1]
            row += [0.0 if rules.gone(i, (r, c)) else 1.0] if leaving else []
        for i, j in combinations(range(len(state)), 2):
            gone = rules.gone(i, state[i]) or rules.gone(j, state[j])
            apart = inf if gone else dist(state[i], state[j])
            farthest = dist((0, 0), (height, width))
            row += [2 * min(apart, farthest) / farthest - 1, 2 / (1 + apart) - 1]
        rows.append(row)
    return np.array(rows)


def naive_costs(costs: NetworkCost, omega: Vector, x: Array) -> Vector:
    """C sigmoid(2 sum_h tanh(v_h) tanh(U_h x + b_h)), unit by unit."""
    d, h = x.shape[1], costs.width
    total = np.zeros(len(x))
    for unit in range(h):
        u, b, v = omega[unit * d : (unit + 1) * d], omega[h * d + unit], omega[h * (d + 1) + unit]
        total += np.tanh(v) * np.tanh(x @ u + b)
    return np.asarray(costs.bound / (1 + np.exp(-2 * total)))


@pytest.mark.parametrize("make", [hallway, doors, trio, slippery])
def test_costs_are_those_of_the_formula(make: Any) -> None:
    game, costs = with_network(make())
    x = naive_inputs(game)
    np.testing.assert_allclose(costs.inputs.values, x, rtol=0, atol=1e-15)
    omega = some_omega(costs)
    expected = naive_costs(costs, omega, x)
    np.testing.assert_allclose(costs.of_states(omega), expected, rtol=0, atol=1e-12)
    swaps = np.array(
        [[game.grid.swapping_in(np.array(s), np.array(a)) for a in range(game.n_actions)] for s in range(game.n_states)]
    )
    table = -expected[:, None] - costs.bound * np.tanh(omega[-1]) * swaps
    np.testing.assert_allclose(costs.table(omega), table, rtol=0, atol=1e-12)


@pytest.mark.parametrize("scale", [0.1, 10.0, 1e6])
def test_what_a_joint_state_costs_is_bounded_for_every_omega(scale: float) -> None:
    _, costs = with_network(hallway())
    for seed in range(5):
        of_states = costs.of_states(some_omega(costs, seed, scale))
        assert of_states.min() >= 0
        assert of_states.max() <= costs.bound


def test_at_first_everything_costs_the_same() -> None:
    _, costs = with_network(hallway())
    table = costs.table(costs.initial(np.random.default_rng(0)))
    assert np.unique(table).tolist() == [-costs.bound / 2]


def test_inputs_can_be_chosen_and_come_in_the_order_of_the_file() -> None:
    game, costs = with_network(hallway(), inputs=("near_1_2", "row_1"))
    x = naive_inputs(game)
    np.testing.assert_array_equal(costs.inputs.values, x[:, [5, 0]])


def test_layers_and_costs_of_the_file_are_inputs() -> None:
    settings = {"layers": {"shade": [[0.0, 0.5, 1.0], [0.25, 0.0, -2.0]]}, "costs": {"far": "distance ** 2"}}
    game = PatrolGame(hallway().settings.model_validate({**hallway().settings.model_dump(), **settings}))
    costs = with_network(game)[1]
    values = dict(zip(costs.inputs.names, costs.inputs.values.T, strict=True))
    cells = game.cells(np.arange(game.n_states))
    np.testing.assert_allclose(values["shade_2"], np.array([0, 0.25, 0.5, 0.125, 0, -1])[cells[1]])
    rows, columns = np.divmod(cells, 3)
    np.testing.assert_allclose(values["far"], ((rows[0] - rows[1]) ** 2 + (columns[0] - columns[1]) ** 2) / 5)


@pytest.mark.parametrize("beside_features", [False, True])
@pytest.mark.parametrize("make", [hallway, doors, trio])
def test_by_expert_it_is_what_it_is_by_tables(make: Any, beside_features: bool) -> None:
    game, costs = with_network(make(), beside_features=beside_features)
    theta, omega = np.random.default_rng(1).normal(size=len(game.reward_features.names)), some_omega(costs)
    fast = SoftBellmanPlanner(game, game.linear_reward(), costs).plan(theta, omega)
    slow = soft_bellman_policy(game, game.reward_features.table(theta) + costs.table(omega))
    assert isinstance(fast, FactoredPolicy)
    np.testing.assert_allclose(fast.values, slow.values, rtol=0, atol=1e-12)
    visits, rng = ExactOccupancy(game), np.random.default_rng(0)
    np.testing.assert_allclose(costs.total(visits(fast, rng)), costs.total(visits(slow, rng)), rtol=0, atol=1e-12)


def torch_loss(game: PatrolGame, costs: NetworkCost, demonstrations: Trajectories, x: Any) -> Any:
    """G = E V_0 - E_demonstrated sum gamma^t (r - c) + P, from the formulas alone; x = (theta, omega)."""
    f, n, h = torch.from_numpy(columns(game, game.reward_features)), costs.inputs.values.shape[1], costs.width
    phi = torch.from_numpy(columns(game, game.cost_features)[:, : costs.size - h * (n + 2) - 1])
    theta, w, omega = x[: f.shape[1]], x[f.shape[1] :][: phi.shape[1]], x[f.shape[1] + phi.shape[1] :]
    u, b, v = omega[: h * n].reshape(h, n), omega[h * n : h * (n + 1)], omega[h * (n + 1) : -1]
    points = torch.from_numpy(costs.inputs.values.copy())
    c = costs.bound * torch.sigmoid(2 * torch.tanh(points @ u.T + b) @ torch.tanh(v))
    swaps = torch.from_numpy(game.swapping.astype(np.float64))
    r = (
        (f @ theta + phi @ w).reshape(game.n_states, game.n_actions)
        - c[:, None]
        - costs.bound * torch.tanh(omega[-1]) * swaps
    )
    value, successor = torch.zeros(game.n_states, dtype=torch.float64), torch.from_numpy(game.successor)
    for _ in range(game.horizon + 1):
        value = torch.logsumexp(r + game.discount * value[successor], dim=1)
    visits = discounted_visitation(demonstrations, game.discount)
    earned = (torch.from_numpy(visits.weights.copy()) * r[visits.states, visits.actions]).sum()
    by_expert = c.reshape((game.n_cells,) * game.n_experts)
    means = (by_expert.mean(dim=tuple(j for j in range(game.n_experts) if j != i)) for i in range(game.n_experts))
    penalty = costs.apart / 2 * sum(((mean - c.mean()) ** 2).mean() for mean in means)
    return torch.from_numpy(game.initial_distribution.copy()) @ value - earned + penalty


def columns(game: PatrolGame, features: TabularFeatureMap) -> Array:
    """Features of all pairs, shape (S A, K)."""
    return np.stack([features.table(unit).ravel() for unit in np.eye(len(features.names))], axis=1)


@pytest.mark.parametrize("beside_features", [False, True])
@pytest.mark.parametrize("make_memory", [WindowMemory, RunningMean])
def test_the_gradient_of_the_whole_loss_is_that_of_torch(make_memory: Any, beside_features: bool) -> None:
    game, costs = with_network(hallway(horizon=3), beside_features=beside_features)
    reward, demonstrations = game.linear_reward(), shown(game)
    planner = SoftBellmanPlanner(game, reward, costs)
    estimator = GradientEstimator(game, reward, planner, ExactOccupancy(game), "initial")
    empty: Memory = make_memory(game, reward, 1) if make_memory is WindowMemory else RunningMean.empty(game, reward)
    rng = np.random.default_rng(2)
    at = Parameters(rng.normal(size=reward.size), some_omega(costs, 3))
    found = estimator(at, empty.add(demonstrations), rng).gradient
    x = torch.from_numpy(np.concatenate(at)).requires_grad_()
    (expected,) = torch.autograd.grad(torch_loss(game, costs, demonstrations, x), x)
    np.testing.assert_allclose(np.concatenate(found), expected.numpy(), rtol=0, atol=1e-11)
    assert (found.omega != 0).mean() > 0.9


def test_the_gradient_of_the_penalty_is_that_of_finite_differences() -> None:
    for make in (hallway, doors, trio):
        costs = with_network(make())[1]
        omega = some_omega(costs)
        found = costs.penalty_gradient(omega)
        np.testing.assert_allclose(found, central_differences(costs.penalty, omega), rtol=0, atol=1e-7)
        assert np.abs(found).max() > 0.01


@pytest.mark.parametrize("make", [hallway, doors, trio])
def test_the_penalty_is_the_variance_of_the_projection_on_reward_features_and_constants(make: Any) -> None:
    """By least squares over all joint states and actions, which are so few here that they can be."""
    game, costs = with_network(make())
    omega = some_omega(costs)
    c = np.repeat(costs.of_states(omega), game.n_actions)
    span = np.column_stack([columns(game, game.reward_features), np.ones(len(c))])
    projected = span @ np.linalg.lstsq(span, c, rcond=None)[0]
    assert costs.penalty(omega) == pytest.approx(costs.apart / 2 * projected.var(), rel=1e-9)
    assert 0 < costs.shared_variance(omega) < c.var()


def test_without_apart_there_is_no_penalty() -> None:
    costs = with_network(hallway(), apart=0.0)[1]
    omega = some_omega(costs)
    assert costs.penalty(omega) == 0
    assert not costs.penalty_gradient(omega).any()


def test_what_the_penalty_is_of_can_move_into_theta_and_no_policy_changes() -> None:
    """The identifiable part is the rest: with the main effects in theta and without them in c, all is as before."""
    game, costs = with_network(hallway(horizon=4))
    omega, theta = some_omega(costs), np.random.default_rng(4).normal(size=len(game.reward_features.names))
    c, places = costs.of_states(omega), costs.inputs.places
    own = c.reshape(game.n_cells, game.n_cells)
    effects = [own.mean(axis=1) - own.mean(), own.mean(axis=0) - own.mean()]
    moved = theta - np.repeat(np.concatenate(effects), game.n_moves)
    rest = c - effects[0][places[0]] - effects[1][places[1]]
    swaps = costs.of_meeting(omega) * game.swapping
    before = soft_bellman_policy(game, game.reward_features.table(theta) + costs.table(omega))
    after = soft_bellman_policy(game, game.reward_features.table(moved) - rest[:, None] - swaps)
    for step in range(game.horizon + 1):
        states = np.arange(game.n_states)
        np.testing.assert_allclose(
            before.log_probabilities(step, states), after.log_probabilities(step, states), atol=1e-12
        )


@pytest.mark.parametrize("make", [hallway, doors])
def test_what_each_pays_alone_is_read_off_as_weights_of_cells_up_to_a_constant(make: Any) -> None:
    game, costs = with_network(make())
    of_cells, cells = np.random.default_rng(0).normal(size=(2, game.n_cells)), game.cells(np.arange(game.n_states))
    of_cells[~game.grid.present] = of_cells.max()  # who has left pays least, and has no features
    of_states = of_cells[0][cells[0]] + of_cells[1][cells[1]]
    weights = costs.inputs.by_feature(StateRewards(of_states, -0.7))
    difference = game.cost_features.table(weights) - of_states[:, None] + 0.7 * game.swapping
    np.testing.assert_allclose(difference, difference[0, 0], rtol=0, atol=1e-12)
    assert weights.max() <= 1e-12


def test_what_sharing_a_cell_costs_beside_is_read_off_with_its_sign_and_scale() -> None:
    for scale in (1.0, 4.0):
        game = PatrolGame(hallway().settings.model_copy(update={"joint_scale": scale}))
        costs = with_network(game)[1]
        weights = costs.inputs.by_feature(StateRewards(-3.0 * game.sharing, -1.0))
        cells = weights[: 2 * game.n_cells]
        np.testing.assert_allclose(cells, 0, atol=1e-12)  # every cell can be shared alike
        assert weights[-2:] * scale == pytest.approx([-3.0 * (1 - 1 / game.n_cells), -1.0])


def test_weights_of_features_stand_beside_the_network() -> None:
    game, alone = with_network(hallway())
    beside, k = with_network(hallway(), beside_features=True)[1], len(game.cost_features.names)
    omega = some_omega(beside)
    np.testing.assert_allclose(beside.table(omega), game.cost_features.table(omega[:k]) + alone.table(omega[k:]))
    np.testing.assert_array_equal(beside.by_feature(omega), omega[:k] + alone.by_feature(omega[k:]))
    np.testing.assert_array_equal(beside.penalty_gradient(omega)[k:], alone.penalty_gradient(omega[k:]))
    assert not beside.penalty_gradient(omega)[:k].any()
    assert not beside.initial(np.random.default_rng(0))[:k].any()
    assert np.flatnonzero(beside.counts).tolist() == list(range(k))
    assert alone.counts is False


def test_costs_of_a_game_that_names_none_are_weights_of_its_features() -> None:
    game = hallway()
    costs, omega = costs_of(game), np.random.default_rng(0).normal(size=len(game.cost_features.names))
    assert costs.linear
    np.testing.assert_array_equal(costs.table(omega), game.cost_features.table(omega))
    assert costs.names == game.cost_features.names
