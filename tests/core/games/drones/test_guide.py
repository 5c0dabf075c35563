"""Values at any place: drones alone by quadrature, what they cost each other by the lattice."""

import numpy as np
import pytest
import torch
from arenas import ARENA, arena

from mabirds_core.arrays import Array
from mabirds_core.games.drones.drone_nodes import DroneNodes, Rewards
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.guide import Guidance, Guide
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.lone_drone import LoneDrone, log_shares, log_sum_exp
from mabirds_core.games.drones.lone_fields import FieldGrid, LoneField, taps
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
        drones, rng = [drone.nodes for drone in guide.lattice.drones], np.random.default_rng(step)
        nodes = [rng.integers(of.reached[step - 1], size=40) for of in drones]
        places = np.stack([of.places[chosen] for of, chosen in zip(drones, nodes, strict=True)], axis=1)
        states, times = torch.tensor(places.reshape(40, 4), dtype=torch.float32), torch.full((40,), step)
        alone = sum(field.at(step, places[:, i]) for i, field in enumerate(guide.fields))
        found = guide.values(times, states).double().numpy() - alone
        expected = guide.lattice.tables[step - 1].values(*nodes)
        assert np.std(expected) > 0.05
        assert np.abs(found - expected).max() < 0.01


def test_its_slope_is_that_of_its_values(guide: Guide) -> None:
    """By finite differences where no triangle's edge is crossed."""
    states = torch.tensor([[0.52, 0.41, 1.07, 0.55], [0.7, 0.9, 0.6, 0.7]], dtype=torch.float32).requires_grad_()
    times = torch.tensor([2, 3])
    (slope,) = torch.autograd.grad(guide.values(times, states).sum(), states)
    for column in range(4):
        way = torch.zeros(4)
        way[column] = 1e-3
        difference = guide.values(times, states + way) - guide.values(times, states - way)
        assert torch.allclose(slope[:, column], difference / 2e-3, rtol=0.02, atol=0.1)
    assert slope.abs().max() > 0.5


def test_past_the_horizon_there_is_nothing(guide: Guide) -> None:
    states = torch.tensor([[0.52, 0.41, 1.07, 0.55]] * 2)
    assert guide.values(torch.tensor([6, 7]), states).tolist() == [0.0, 0.0]


def test_values_at_starts_are_those_of_both_drones(guide: Guide) -> None:
    """V_0 less that of each drone alone is C_0, as on the lattice."""
    states = guide.game.starts(5, np.random.default_rng(0))
    places = guide.game.positions(states)
    alone = sum(field.at(0, places[:, i]) for i, field in enumerate(guide.fields))
    of_lattice = sum(guide.lattice.lone_values(i, places[:, i]) for i in range(2))
    assert np.allclose(guide.start_values(states) - alone, guide.lattice.values(0, states) - of_lattice)
