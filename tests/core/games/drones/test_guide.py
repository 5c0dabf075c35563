"""Values at any place: drones alone by quadrature, what they cost each other by the lattice."""

import numpy as np
import pytest
from arenas import ARENA, arena

from mabirds_core.arrays import Array
from mabirds_core.games.drones.arrival import ArrivingDroneReward
from mabirds_core.games.drones.drone_nodes import DroneNodes, Rewards
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.guide import Guidance, Guide
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.lone_drone import LoneDrone, log_shares, log_sum_exp
from mabirds_core.games.drones.lone_fields import STEEP, FieldGrid, LoneField, steps_left, taps
from mabirds_core.games.drones.nodes import NodeLattice
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.drones.settings import DroneSettings


def rewards_of(game: DroneGame, seed: int = 0) -> Rewards:
    reward, rng = LinearDroneReward(game), np.random.default_rng(seed)
    omega = rng.normal(-0.5, 0.5, size=len(game.cost_features.names))
    return ((reward, rng.normal(size=reward.size)), (game.cost_features, omega))


def disc(count: int, rng: np.random.Generator) -> Array:
    radii, angles = np.sqrt(rng.random(count)), 2 * np.pi * rng.random(count)
    return np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)


def test_interpolation_is_exact_for_cubics() -> None:
    axis, at = np.linspace(0, 2, 9), np.random.default_rng(0).uniform(0, 2, size=50)
    weights = taps(axis, at)
    assert np.allclose(weights.sum(axis=1), 1)
    assert np.allclose(weights @ (axis**3 - 2 * axis), at**3 - 2 * at)


def test_a_single_decision_is_the_integral_over_the_disc() -> None:
    """T = 1: V_1 = r + log of the mean of exp(e) over the disc, in closed form; V_0 by a million random actions."""
    game = arena(1, {"horizon": 1})
    rewards = rewards_of(game)
    field, place, still = LoneField.of(FieldGrid(game, 0), rewards, 0.5), np.array([[1.02, 0.9]]), np.zeros((1, 2))

    def reward(places: Array, actions: Array) -> Array:
        return np.asarray(sum(of.unary(w, 0, places, actions) for of, w in rewards)) / 0.5

    effort = float(reward(place, np.array([[1.2, 0.0]]))[0] - reward(place, still)[0])

    def last(places: Array) -> Array:
        free = reward(places, np.zeros_like(places)) + np.log(np.expm1(effort) / effort)
        return np.where(field.grid.arrived(places), reward(places, np.zeros_like(places)), free)

    assert field.at(1, place) == pytest.approx(last(place), abs=0.01)
    actions = 1.2 * disc(1_000_000, np.random.default_rng(1))
    after = np.clip(place + 0.25 * actions, 0, game.settings.arena)
    assert field.grid.arrived(after).mean() > 0.1
    expected = np.log(np.exp(reward(place, actions) + game.discount * last(after)).mean())
    assert field.at(0, place)[0] == pytest.approx(expected, abs=0.03)


def test_ever_finer_lattices_come_near() -> None:
    """Far from walls, into which lattices have no moves. Their V_0 falls towards that of continuous actions."""
    task = {"start": (1.5, 1.4), "goal_region": {"centre": (2.2, 1.6), "radius": 0.3}}
    game = DroneGame(DroneSettings.model_validate({**ARENA, "arena": (3.6, 3.0), "drones": [task], "horizon": 3}))
    rewards, reach, place = rewards_of(game), game.dynamics.reach, np.array([[1.5, 1.4]])
    exact, errors = LoneField.of(FieldGrid(game, 0), rewards, 0.5).at(0, place)[0], []
    for squared in (3, 13, 49):
        lattice = NodeLattice.one_of(game.settings.arena, reach, reach / squared**0.5, "hexagonal", 0, 1)
        lone = LoneDrone.of(DroneNodes(game, lattice, 0), rewards, 0.5)
        moves = lone.nodes.moves_from(place)
        ahead = lone.nodes.rewards(rewards, place, moves.nodes) / 0.5 + game.discount * lone.values[1][moves.nodes]
        errors.append(log_sum_exp(log_shares(moves.shares) + ahead)[0] - exact)
    assert abs(errors[-1]) < 0.1, errors
    assert errors[-1] < errors[0], errors


@pytest.fixture(scope="module")
def guide() -> Guide:
    game = arena(2, {"horizon": 5})
    (reward, theta), (_, omega) = rewards_of(game)
    planner = LatticePlanner(game, reward, game.dynamics.reach / 3**0.5, 0.5)  # type: ignore[arg-type]
    return Guidance(planner).guide(theta, omega, None, np.random.default_rng(0))


def test_at_nodes_the_coupling_is_that_of_the_lattice(guide: Guide) -> None:
    for step in (2, 3, 5):
        drones, rng = [drone.nodes for drone in guide.couplings[0].lattice.drones], np.random.default_rng(step)
        nodes = [rng.integers(of.reached[step - 1], size=40) for of in drones]
        places = np.stack([of.places[chosen] for of, chosen in zip(drones, nodes, strict=True)], axis=1)
        alone = sum(field.at(step, places[:, i]) for i, field in enumerate(guide.fields))
        found = guide.values(step, places.reshape(40, 4)) - alone
        expected = guide.couplings[0].lattice.tables[step - 1].values(*nodes)
        assert np.std(expected) > 0.05
        assert np.abs(found - expected).max() < 0.01


def test_between_nodes_the_coupling_is_linear_and_of_every_two_places(guide: Guide) -> None:
    """In a triangle of nodes, and the same whether places are asked for one by one or all together."""
    nodes, rng = guide.couplings[0].lattice.drones[0].nodes, np.random.default_rng(4)
    corner = nodes.places[rng.integers(nodes.reached[1], size=6)]
    triangle = np.stack([corner, *(corner + way for way in nodes.lattice.basis)], axis=1)
    shares = rng.dirichlet(np.ones(3), size=6)
    inside = (shares[..., None] * triangle).sum(axis=1)
    others = rng.uniform([1.1, 0.1], [1.5, 0.3], size=(6, 4, 2))
    at_corners = guide.couplings[0].values(4, triangle, others)
    expected = (shares[..., None] * at_corners).sum(axis=1)
    found = guide.couplings[0].values(4, inside[:, None], others)[:, 0]
    known = np.isin(triangle.round(6), nodes.places[: nodes.reached[3]].round(6)).all(axis=(1, 2))
    assert known.sum() >= 2
    assert np.abs(found - expected)[known].max() < 0.01
    assert np.ptp(at_corners[known]) > 0.05


def test_past_the_horizon_there_is_nothing(guide: Guide) -> None:
    states = np.array([[0.52, 0.41, 1.07, 0.55]] * 2)
    assert guide.values(6, states).tolist() == guide.values(7, states).tolist() == [0.0, 0.0]


def late_rewards(game: DroneGame, nats: float) -> Rewards:
    """With what it costs to be late, a hundred times what else is at stake."""
    reward = ArrivingDroneReward(game)
    theta = np.random.default_rng(2).normal(size=reward.size)
    theta[reward.counts] = -nats / 10
    return ((reward, theta), (game.cost_features, np.full(len(game.cost_features.names), -0.2)))


def test_cubics_do_not_overshoot_where_lateness_makes_values_jump() -> None:
    """Free cubics would promise more at the brink than a drone can have anywhere, and draw it there."""
    game = arena(1, {"horizon": 6})
    field = LoneField.of(FieldGrid(game, 0), late_rewards(game, 200.0), 0.5)
    values, rng = field.values[5], np.random.default_rng(0)
    assert np.ptp(values) > 10 * STEEP
    for places in (field.grid.after.reshape(-1, 2), rng.uniform(0, game.settings.arena, size=(5000, 2))):
        away = places[~field.grid.arrived(places)]
        x, y = (taps(axis, away[:, i]) for i, axis in enumerate(field.grid.axes))
        free = np.einsum("mx,my,xy->m", x, y, values)
        assert free.max() > values.max() + 5
        assert field.at(5, away).max() < values.max() + 1
    assert field.grid.shifted(values).max() < values.max() + 1


def test_in_its_goal_region_a_drone_earns_what_it_stays_for_however_late_it_might_have_been() -> None:
    game = arena(1, {"horizon": 6})
    rewards = late_rewards(game, 200.0)
    field = LoneField.of(FieldGrid(game, 0), rewards, 0.5)
    places = np.array([1.3, 1.0]) + 0.19 * disc(50, np.random.default_rng(3))
    stays = sum(of.unary(w, 0, places, np.zeros((50, 2))) for of, w in rewards) / 0.5
    assert field.at(3, places) == pytest.approx(steps_left(game)[3] * stays, abs=0.3)


def test_what_actions_are_worth_is_what_the_game_says() -> None:
    """At t = T nothing follows: r(s, a) - r(s, 0), of who is under way, arrives or has arrived."""
    game = arena(2, {"horizon": 6})
    rewards = late_rewards(game, 30.0)
    reward, theta = rewards[0]
    guide = Guidance(LatticePlanner(game, reward, game.dynamics.reach / 3**0.5, 0.5)).guide(  # type: ignore[arg-type]
        theta, rewards[1][1], None, np.random.default_rng(0)
    )
    rng = np.random.default_rng(1)
    places, actions = rng.uniform(0, game.settings.arena, size=(300, 2)), 1.2 * disc(300, rng)
    rest = np.tile([1.3, 0.2], (300, 1))
    states, moves = np.hstack([places, rest]), np.hstack([actions, np.zeros((300, 2))])
    earned = [
        sum(total_reward(game.space, of, w, states, chosen) for of, w in rewards) / 0.5
        for chosen in (moves, np.zeros_like(moves))
    ]
    worth, after = guide.worth(0, 6, places, actions[:, None])
    under_way, arrives = (~guide.fields[0].grid.arrived(places), guide.fields[0].grid.arrived(after[:, 0]))
    assert (under_way & arrives).any()
    assert np.allclose(after[:, 0], game.step(states, moves)[:, :2])
    assert np.allclose(worth[:, 0], np.where(under_way, earned[0] - earned[1], 0.0), atol=1e-6)


def test_values_at_starts_are_those_of_both_drones(guide: Guide) -> None:
    """V_0 less that of each drone alone is C_0, as on the lattice."""
    states = guide.game.starts(5, np.random.default_rng(0))
    places = guide.game.positions(states)
    alone = sum(field.at(0, places[:, i]) for i, field in enumerate(guide.fields))
    of_lattice = sum(guide.couplings[0].lattice.lone_values(i, places[:, i]) for i in range(2))
    assert np.allclose(guide.start_values(states) - alone, guide.couplings[0].lattice.values(0, states) - of_lattice)
