"""Soft value iteration on a lattice against sums over all joint moves that are written out, and what theory says."""

import numpy as np
import pytest
from arenas import arena, random_rollouts
from hypothesis import given, settings
from hypothesis import strategies as st
from slow_lattice import Model, SlowLattice

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.arrival import ArrivingDroneReward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePlanner, LatticePolicy
from mabirds_core.games.drones.rewards import LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.drones.rollouts import SampledDroneOccupancy, drone_rollouts
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_core.kernels.loading import library

every_size = pytest.mark.parametrize("drones", [1, 2])

ROUNDING = 0.0025
"""Half a step of what two drones cost each other, summed over the steps of a tiny game [nats]."""


@pytest.fixture(params=["compiled", "numpy"])
def kernels(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """With the compiled kernels where there are some, and without."""
    if request.param == "numpy":
        monkeypatch.setattr("mabirds_core.games.drones.coupling.library", lambda: None)
    elif library() is None:
        pytest.skip("kernels are not compiled")


def some_parameters(model: Model, scale: float = 1.0, seed: int = 0) -> Parameters:
    rng = np.random.default_rng(seed)
    sizes = model.size, len(model.game.cost_features.names)
    return Parameters(*(scale * rng.normal(size=size) for size in sizes))


def found(model: Model, at: Parameters, spacing: float = 0.2, temperature: float = 1.0) -> LatticePolicy:
    return LatticePlanner(model.game, model, spacing, temperature).plan(*at)


def tiny(drones: int) -> DroneGame:
    """Three steps; a lattice of 0.4 m has twelve nodes or so, and goal regions hold some of them."""
    goals = {f"drones.{drone}.goal_region.radius": 0.35 for drone in range(drones)}
    return arena(drones, {"horizon": 2, "max_speed": 2.0, **goals})


def neural(game: DroneGame) -> NeuralDroneReward:
    return NeuralDroneReward(game, hidden=4, bound=5.0)


def slow_and_fast(model: Model, at: Parameters, temperature: float = 1.0) -> tuple[SlowLattice, LatticePolicy]:
    planner = LatticePlanner(model.game, model, 0.4, temperature)
    return SlowLattice(model, at, planner.lattices[0][0].lattice, temperature), planner.plan(*at)


def own_numbers(policy: LatticePolicy, slow: SlowLattice) -> list[Array]:
    """By number in the lattice: the number that each drone has for a node."""
    return [drone.nodes.nearest(slow.lattice.places) for drone in policy.drones]


def reachable(policy: LatticePolicy, slow: SlowLattice, step: int) -> list[tuple[int, ...]]:
    """Joint nodes that can have been reached by a step."""
    numbers = own_numbers(policy, slow)
    counts = [drone.nodes.reached[step - 1] for drone in policy.drones]
    return [state for state in slow.states if all(numbers[i][node] < counts[i] for i, node in enumerate(state))]


@every_size
@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize(
    ("make", "scale", "temperature"),
    [
        (LinearDroneReward, 1.0, 1.0),
        (LinearDroneReward, 0.3, 0.1),
        (LinearDroneReward, 20.0, 1.0),
        (ArrivingDroneReward, 0.3, 1.0),
        (neural, 1.0, 0.5),
        (TrueDroneReward, 1.0, 0.1),
    ],
)
def test_values_are_those_of_all_joint_moves_summed_up(
    drones: int, make: type[LinearDroneReward], scale: float, temperature: float
) -> None:
    model = make(tiny(drones))
    slow, policy = slow_and_fast(model, some_parameters(model, scale), temperature)
    for step in (1, 2):
        states = reachable(policy, slow, step)
        places = np.array([np.concatenate([slow.lattice.places[node] for node in state]) for state in states])
        expected = [slow.values[(step, *state)] for state in states]
        np.testing.assert_allclose(
            policy.values(step, places), expected, rtol=0, atol=ROUNDING if drones == 2 else 1e-9
        )
    assert len(states) > 3**drones
    assert np.ptp(expected) > 1


@every_size
@pytest.mark.usefixtures("kernels")
@pytest.mark.parametrize("temperature", [1.0, 0.1])
def test_the_policy_is_that_of_all_joint_moves_from_starts_between_the_nodes(drones: int, temperature: float) -> None:
    model = LinearDroneReward(tiny(drones))
    slow, policy = slow_and_fast(model, some_parameters(model), temperature)
    numbers = own_numbers(policy, slow)
    for state in model.game.starts(5, np.random.default_rng(1)):
        expected = slow.log_ratios(0, state)
        nodes = [np.array([numbers[i][moves[i]] for moves in expected]) for i in range(drones)]
        ratios = policy.choices(0, np.tile(state, (len(expected), 1))).log_ratios(nodes)
        np.testing.assert_allclose(ratios, list(expected.values()), rtol=0, atol=ROUNDING)
        assert np.ptp(ratios) > 0.1


@every_size
def test_rollouts_do_what_the_analytic_occupancy_says(drones: int) -> None:
    """Discounted totals of every cost feature, within 5 standard errors of 4000 rollouts."""
    model, count = LinearDroneReward(tiny(drones)), 4000
    slow, policy = slow_and_fast(model, some_parameters(model, 0.4))
    starts = model.game.starts(3, np.random.default_rng(2))
    rollouts = drone_rollouts(model.game, policy, count, np.random.default_rng(3), starts)
    each = per_rollout(model, np.zeros(model.size), rollouts)[:, model.size :]
    error = each.std(axis=0) / np.sqrt(count) + 1e-9
    assert (np.abs(each.mean(axis=0) - slow.totals(starts)) < 5 * error).all()
    assert (error > 1e-4).mean() > 0.5


@every_size
@pytest.mark.usefixtures("kernels")
@settings(deadline=None, max_examples=15, derandomize=True)
@given(seed=st.integers(0, 1000), scale=st.sampled_from([0.1, 1.0, 10.0]), number=st.integers(0, 3))
def test_the_value_is_what_every_flight_earns_less_what_it_chose(
    drones: int, seed: int, scale: float, number: int
) -> None:
    """The certificate, over random theta and omega, on every lattice: at most .1 nat.

    Closeness may cost hundreds of nats a step. It may not earn more than some: what drones do because of each other
    must be something that each might do alone, if only with a probability of exp(-80).
    """
    model = LinearDroneReward(arena(drones, {"horizon": 8}))
    planner, at = LatticePlanner(model.game, model, 0.15, 1.0, rotations=4), some_parameters(model, scale, seed)
    if drones == 2:
        closeness = at.omega[-4:-2]
        closeness[:] = np.minimum(20 * closeness, 3.0)
    policy = planner.plan(*at, rng=np.random.default_rng(number))
    flights = drone_rollouts(model.game, policy, 30, np.random.default_rng(seed))
    assert np.abs(policy.residuals(flights)).max() <= (0.1 if drones == 2 else 1e-8)


def test_the_certificate_fails_for_values_of_other_parameters() -> None:
    model = LinearDroneReward(arena(2))
    policy, other = (found(model, some_parameters(model, seed=seed)) for seed in (0, 1))
    flights = drone_rollouts(model.game, policy, 30, np.random.default_rng(0))
    mixed = LatticePolicy(policy.game, other.rewards, 1.0, policy.drones, policy.tables, policy.memory)
    assert np.abs(mixed.residuals(flights)).max() > 1


def test_with_and_without_a_compiler_the_values_are_the_same() -> None:
    if library() is None:
        pytest.skip("kernels are not compiled")
    model = LinearDroneReward(arena(2, {"horizon": 8}))
    at = some_parameters(model, 3.0)
    compiled = found(model, at, 0.1)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("mabirds_core.games.drones.coupling.library", lambda: None)
        plain = found(model, at, 0.1)
    counts = zip(*(drone.nodes.reached[:-1] for drone in compiled.drones), strict=True)
    for one, other, (first, second) in zip(compiled.tables, plain.tables, counts, strict=True):
        assert one.top == pytest.approx(other.top, abs=1e-3)
        nodes = np.ogrid[:first, :second]
        np.testing.assert_allclose(one.values(*nodes) - one.top, other.values(*nodes) - other.top, rtol=0, atol=0.003)
    assert np.ptp(compiled.tables[0].codes) > 1000


def test_flights_go_from_node_to_node() -> None:
    model = LinearDroneReward(arena(2, {"horizon": 8}))
    policy = found(model, some_parameters(model))
    flights = drone_rollouts(model.game, policy, 50, np.random.default_rng(0))
    places, velocities = model.game.positions(flights.states), model.game.controls(flights.actions)
    under_way = ~model.game.arrived(flights.states[:, 0])
    for i, drone in enumerate(policy.drones):
        _, away = drone.nodes.lattice.nearest(places[under_way[:, i], 1:, i].reshape(-1, 2))
        assert away.max() < 1e-9
    assert np.hypot(*np.moveaxis(velocities, -1, 0)).max() <= 1.2 * (1 + 1e-6)
    assert model.game.decode(flights.states[0], flights.actions[0])


def test_every_plan_draws_a_lattice_and_judges_have_their_own() -> None:
    model = LinearDroneReward(arena(2))
    planner, at = LatticePlanner(model.game, model, 0.2, 1.0, rotations=3), some_parameters(model)
    numbers = [of[0] for of in planner.lattices]
    drawn = [numbers.index(planner.plan(*at, rng=np.random.default_rng(seed)).drones[0].nodes) for seed in range(30)]
    assert set(drawn) == {1, 2, 3}
    assert drawn == [1 + int(np.random.default_rng(seed).integers(3)) for seed in range(30)]
    assert numbers.index(planner.plan(*at).drones[0].nodes) == 0


def test_a_previous_policy_is_used_up() -> None:
    model = LinearDroneReward(arena(2))
    planner, at = LatticePlanner(model.game, model, 0.2, 1.0), some_parameters(model)
    states = model.game.starts(5, np.random.default_rng(0))
    first = planner.plan(*some_parameters(model, seed=1))
    fresh, second = planner.plan(*at), planner.plan(*at, first)
    assert first.memory is second.memory
    np.testing.assert_array_equal(second.values(0, states), fresh.values(0, states))
    with pytest.raises(ValueError, match="this policy was the previous one of another plan"):
        first.values(0, states)


def test_starts_that_were_not_planned_for_are_named() -> None:
    model = LinearDroneReward(arena(2))
    policy = found(model, some_parameters(model))
    with pytest.raises(ValueError, match=r"drone 1 at \[1.5, 0.2\] before step 1: .* make start_spread larger"):
        policy.act(0, np.array([[1.5, 0.2, 1.3, 0.2]]), np.random.default_rng(0))


def test_moves_of_another_lattice_are_refused() -> None:
    model = LinearDroneReward(arena(2))
    policy, other = found(model, some_parameters(model)), found(model, some_parameters(model), 0.17)
    flights = drone_rollouts(model.game, other, 5, np.random.default_rng(0))
    with pytest.raises(ValueError, match="these flights are of another lattice"):
        policy.residuals(flights)


@every_size
def test_moves_are_drawn_with_the_policys_probabilities(drones: int) -> None:
    model, count = LinearDroneReward(tiny(drones)), 20_000
    policy = found(model, some_parameters(model), 0.4)
    state = np.array([0.35, 0.3, 1.3, 0.25])[: 2 * drones]
    drawn = policy.act(0, np.tile(state, (count, 1)), np.random.default_rng(2))
    choices = policy.choices(0, state[None])
    chances = np.exp(choices.scores[0] - choices.scores[0].max()).ravel()
    chances /= chances.sum()
    ways = [
        drone.nodes.velocities(state[None, 2 * i : 2 * i + 2], choices.nodes[i])[0]
        for i, drone in enumerate(policy.drones)
    ]
    joint = [
        np.concatenate([ways[i][k] for i, k in enumerate(index)])
        for index in np.ndindex(*choices.scores.shape[1 : 1 + drones])
    ]
    shares = np.array([(np.abs(drawn - one) < 1e-9).all(axis=1).mean() for one in joint])
    spread = np.sqrt(chances * (1 - chances) / count)
    assert shares.sum() == pytest.approx(1)
    assert (np.abs(shares - chances) <= 5 * spread + 1 / count).all()
    assert chances.max() < 0.7


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
    states = one.starts(20, np.random.default_rng(0))
    values = found(LinearDroneReward(one), at).values(0, states)
    swapped = found(LinearDroneReward(other), exchanged(at, one)).values(0, np.roll(states, 2, axis=1))
    np.testing.assert_allclose(swapped, values, rtol=0, atol=ROUNDING)
    assert np.ptp(values) > 0.1


@every_size
def test_a_temperature_divides_the_reward(drones: int) -> None:
    model = LinearDroneReward(arena(drones))
    at = some_parameters(model)
    cold = found(model, at, temperature=0.2)
    large = found(model, Parameters(at.theta / 0.2, at.omega / 0.2))
    states = model.game.starts(5, np.random.default_rng(0))
    np.testing.assert_allclose(cold.values(0, states), large.values(0, states), rtol=0, atol=1e-9)
    scores = (policy.choices(0, states).scores for policy in (cold, large))
    np.testing.assert_allclose(*scores, rtol=0, atol=1e-9)


@every_size
def test_without_rewards_every_value_is_zero_and_moves_have_their_shares(drones: int) -> None:
    model = LinearDroneReward(arena(drones))
    policy, states = found(model, some_parameters(model, scale=0.0)), model.game.starts(5, np.random.default_rng(0))
    np.testing.assert_allclose(policy.values(0, states), 0, atol=1e-5)
    choices = policy.choices(0, states)
    np.testing.assert_allclose(choices.scores, choices.log_shares, rtol=0, atol=1e-5)


@every_size
def test_the_last_effort_costs_what_it_does_in_closed_form(drones: int) -> None:
    """sum_i log sum_a mu(a) exp(-w_i 0.3 |a|^2 / v^2) of the last step, where drones are far from each other."""
    model = LinearDroneReward(arena(drones))
    at = some_parameters(model, scale=0.0)
    at.omega[-drones:] = [-7.0, -2.0][:drones]
    policy, states = found(model, at), model.game.starts(5, np.random.default_rng(0))
    expected = np.zeros(5)
    for i, (drone, weight) in enumerate(zip(policy.drones, at.omega[-drones:], strict=True)):
        places = model.game.positions(states)[:, i]
        nodes, shares = drone.nodes.moves_from(places)
        speeds = np.hypot(*np.moveaxis(drone.nodes.velocities(places, nodes), -1, 0)) / 1.2
        expected += np.log((shares * np.exp(weight * 0.3 * speeds**2)).sum(axis=1))
    np.testing.assert_allclose(policy.values(model.game.horizon, states), expected, rtol=0, atol=1e-12)
    assert (expected < -0.1).all()


@every_size
def test_lattices_agree_on_values_of_smooth_rewards(drones: int) -> None:
    """The finer they are, the better those that are turned and shifted otherwise do."""
    smooth = {"features.cost_width": 0.5, "features.distance_softness": 0.3, "horizon": 5}
    model = LinearDroneReward(arena(drones, smooth))
    at, states = some_parameters(model, seed=4), model.game.starts(20, np.random.default_rng(0))
    spread = []
    for spacing in (0.3, 0.1):
        planner = LatticePlanner(model.game, model, spacing, 1.0, rotations=5)
        values = [planner.plan(*at, rng=np.random.default_rng(seed)).values(0, states) for seed in range(10)]
        spread.append(float(np.std(values, axis=0).mean()))
    assert spread[0] > 2 * spread[1]


@every_size
def test_a_policy_is_found_and_followed_alike_every_time(drones: int) -> None:
    model = neural(arena(drones))
    at = some_parameters(model)
    one, other = (found(model, at) for _ in range(2))
    rollouts = [drone_rollouts(model.game, policy, 20, np.random.default_rng(5)) for policy in (one, other)]
    for found_steps, expected in zip(*rollouts, strict=True):
        np.testing.assert_array_equal(found_steps, expected)


@every_size
def test_what_a_planner_found_before_changes_nothing(drones: int) -> None:
    model = LinearDroneReward(arena(drones))
    planner, one, other = (
        LatticePlanner(model.game, model, 0.2, 1.0),
        some_parameters(model),
        some_parameters(model, seed=1),
    )
    states = model.game.starts(5, np.random.default_rng(0))
    first = planner.plan(*one)
    before = first.values(0, states)
    planner.plan(*other)
    np.testing.assert_array_equal(planner.plan(*one).values(0, states), before)
    np.testing.assert_array_equal(first.values(0, states), before)
    np.testing.assert_array_equal(found(model, other).values(0, states), planner.plan(*other).values(0, states))


def test_a_planner_remembers_nothing() -> None:
    model = LinearDroneReward(arena(2))
    planner = LatticePlanner(model.game, model, 0.2, 1.0)
    assert planner.state_dict(planner.plan(*some_parameters(model))) == {}
    assert planner.load_state_dict({}) is None


@every_size
def test_drones_avoid_what_costs_and_seek_what_pays(drones: int) -> None:
    sharp = {"cost_spacing": 0.2, "cost_width": 0.12, "distance_levels": (0.3, 0.4)}
    changes = {f"features.{name}": value for name, value in sharp.items()}
    game = arena(drones, {"horizon": 24, "time_step": 0.125, **changes})
    model, omega = TrueDroneReward(game), -1.0 * game.true_constraints
    if drones == 2:
        omega[-4:-2] = -1.0  # what is nearer than .4 m at the steps may be nearer than .3 m between them
    careful, careless = (
        drone_rollouts(game, found(model, Parameters(np.zeros(0), of), 0.08, 0.03), 300, np.random.default_rng(6))
        for of in (omega, 0 * omega)
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
    planner = LatticePlanner(game, model, 0.2, 1.0)
    estimator = GradientEstimator(game, model, planner, SampledDroneOccupancy(game, count), "initial")
    own = drone_rollouts(game, planner.plan(*at), count, np.random.default_rng(8))
    error = per_rollout(model, at.theta, own).std(axis=0) * np.sqrt(2 / count) + 1e-9
    gradient = estimator(at, estimator.window(1).add(own), np.random.default_rng(9)).gradient
    assert (np.abs(np.concatenate(gradient)) < 4.5 * error).all()
    foreign = drone_rollouts(game, planner.plan(-at.theta, -at.omega), count, np.random.default_rng(8))
    gradient = estimator(at, estimator.window(1).add(foreign), np.random.default_rng(9)).gradient
    assert (np.abs(np.concatenate(gradient)) > 4.5 * error).mean() > 0.3
