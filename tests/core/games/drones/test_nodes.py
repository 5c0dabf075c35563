"""Lattices of nodes: whole, turned, shifted; moves against distances, shares against areas, reach against sets."""

import numpy as np
import pytest
from arenas import arena

from mabirds_core.arrays import Array
from mabirds_core.games.drones.drone_nodes import DroneNodes, pair_rewards
from mabirds_core.games.drones.nodes import COVERING, NodeLattice, Shape
from mabirds_core.games.drones.rewards import LinearDroneReward

every_shape = pytest.mark.parametrize("shape", ["hexagonal", "square"])


def lattice(number: int = 0, spacing: float = 0.1, shape: Shape = "hexagonal") -> NodeLattice:
    return NodeLattice.one_of((1.6, 1.2), 0.25, spacing, shape, number, 5)


def lengths(vectors: Array) -> Array:
    return np.asarray(np.hypot(vectors[..., 0], vectors[..., 1]))


@every_shape
@pytest.mark.parametrize("number", range(5))
def test_nodes_fill_the_arena(number: int, shape: Shape) -> None:
    """Each is in it, the nearest others are a spacing away, and every place has one in covering distance or a wall."""
    nodes = lattice(number, shape=shape)
    places = nodes.places
    assert ((places >= 0) & (places <= (1.6, 1.2))).all()
    away = lengths(places[:, None] - places)
    np.testing.assert_allclose(np.sort(away, axis=1)[:, 1], 0.1, atol=1e-9)
    anywhere = np.random.default_rng(0).uniform((0.1, 0.1), (1.5, 1.1), (1000, 2))
    assert lengths(anywhere[:, None] - places).min(axis=1).max() <= COVERING[shape] * 0.1 + 1e-9
    density = 0.1**2 * (np.sqrt(3) / 2 if shape == "hexagonal" else 1)
    assert len(places) == pytest.approx(1.6 * 1.2 / density, rel=0.06)


@pytest.mark.parametrize(
    ("shape", "spacing", "count"),
    [
        ("hexagonal", 0.25, 7),
        ("hexagonal", 0.25 / 3**0.5, 13),
        ("hexagonal", 0.125, 19),
        ("hexagonal", 0.25 / 7**0.5, 31),
        ("square", 0.25 / 5**0.5, 21),
    ],
)
def test_a_step_reaches_as_many_nodes_as_geometry_says(shape: Shape, spacing: float, count: int) -> None:
    nodes = lattice(2, spacing, shape)
    inside = ((nodes.places > 0.3) & (nodes.places < (1.3, 0.9))).all(axis=1)
    assert inside.any()
    assert ((nodes.moves.nodes[inside] >= 0).sum(axis=1) == count).all()


def test_lattices_are_turned_and_shifted_against_each_other() -> None:
    every = [lattice(number) for number in range(5)]
    for k, one in enumerate(every):
        for other in every[:k]:
            assert lengths(one.places[:, None] - other.places).min(axis=1).max() > 0.03
            turned = np.linalg.solve(one.basis.T, other.basis.T)
            assert np.abs(turned - turned.round()).max() > 0.1


@every_shape
def test_moves_go_to_every_node_within_reach_and_no_other(shape: Shape) -> None:
    nodes = lattice(1, shape=shape)
    places = np.concatenate([nodes.places, np.random.default_rng(1).uniform(0, (1.6, 1.2), (50, 2))])
    targets, shares = nodes.moves_from(places)
    within = lengths(places[:, None] - nodes.places) <= 0.25 * (1 + 1e-9)
    for own, some, near in zip(targets, shares, within, strict=True):
        assert sorted(own[own >= 0]) == np.flatnonzero(near).tolist()
        assert (some[own < 0] == 0).all()
    np.testing.assert_allclose(shares.sum(axis=1), 1, atol=1e-12)


def test_shares_are_areas() -> None:
    """Of the disc, by the middles of 90,000 squares; the middle one is a hexagon's."""
    nodes = lattice(1, 0.25 / 3**0.5)
    middle = nodes.places[lengths(nodes.places - (0.8, 0.6)).argmin()]
    places = np.array([middle, (0.81, 0.63), (0.02, 0.03), (1.6, 0.5)])
    targets, shares = nodes.moves_from(places)
    axis = (np.arange(300) + 0.5) / 150 - 1
    points = 0.25 * np.stack(np.meshgrid(axis, axis), axis=-1).reshape(-1, 2)
    points = points[lengths(points) <= 0.25]
    for place, own, some in zip(places, targets, shares, strict=True):
        there = nodes.places[own[own >= 0]]
        nearest = lengths(place + points[:, None] - there).argmin(axis=1)
        expected = np.bincount(nearest, minlength=len(there)) / len(points)
        np.testing.assert_allclose(some[own >= 0], expected, atol=0.006)
    assert shares[0, 0] == pytest.approx(3**0.5 / 2 / (3 * np.pi), abs=0.006)


def test_where_no_node_is_within_reach_the_place_is_named() -> None:
    with pytest.raises(ValueError, match=r"no node of the lattice is within 0.25 m of \[0.8, 0.6\]; take a smaller"):
        NodeLattice((1.6, 1.2), 0.25, 5.0, shift=(0.5, 0.5)).moves_from(np.array([[0.8, 0.6]]))


@pytest.mark.parametrize("drone", [0, 1])
def test_nodes_are_numbered_as_they_can_be_reached(drone: int) -> None:
    """Against sets that grow step by step from the square of starts."""
    game = arena(2, {"horizon": 5})
    nodes = DroneNodes(game, NodeLattice.one_of((1.6, 1.2), 0.3, 0.15, "hexagonal", 1, 4), drone)
    task = game.settings.drones[drone]
    corner = np.clip(nodes.places, np.subtract(task.start, 0.1), np.add(task.start, 0.1))
    reached = lengths(nodes.places - corner) <= 0.3 + 1e-9
    away = lengths(nodes.places - task.goal_region.centre) > task.goal_region.radius
    for count in nodes.reached:
        assert np.flatnonzero(reached).tolist() == list(range(count))
        leaving = nodes.places[reached & away]
        reached = reached | (lengths(nodes.places[:, None] - leaving).min(axis=1) <= 0.3 + 1e-9)
    assert 0 < nodes.reached[0] < nodes.reached[-1]


def test_goal_regions_absorb_nodes_and_places_between_them() -> None:
    game = arena(1)
    nodes = DroneNodes(game, NodeLattice.one_of((1.6, 1.2), 0.3, 0.15, "hexagonal", 1, 4), 0)
    inside = game.arrived(nodes.places)[:, 0]
    assert inside.any()
    np.testing.assert_array_equal(nodes.moves.nodes[inside][:, 0], np.flatnonzero(inside))
    assert (nodes.moves.nodes[inside][:, 1:] == -1).all()
    place = np.array([[1.31, 1.02], [0.31, 0.32]])
    targets, shares = nodes.moves_from(place)
    assert targets[0].tolist() == [lengths(nodes.places - place[0]).argmin(), *[-1] * (targets.shape[1] - 1)]
    assert shares[0, 0] == 1
    velocities = nodes.velocities(place, np.maximum(targets, 0))
    assert not velocities[0].any()
    there = targets[1] >= 0
    after = place[1] + 0.25 * velocities[1][there]
    np.testing.assert_allclose(after, nodes.places[targets[1][there]], atol=1e-12)


def test_what_pairs_earn_is_that_of_their_distances() -> None:
    game = arena(2)
    first, second = (
        DroneNodes(game, NodeLattice.one_of((1.6, 1.2), 0.3, 0.2, "hexagonal", 2, 4), drone) for drone in (0, 1)
    )
    rng = np.random.default_rng(0)
    model = LinearDroneReward(game)
    rewards = (model, rng.normal(size=model.size)), (game.cost_features, rng.normal(size=len(game.cost_features.names)))
    table = pair_rewards(first, second, rewards, np.ogrid[: first.size, : second.size])
    distances = lengths(first.places[:, None] - second.places)
    expected = game.cost_features.pairwise(rewards[1][1], 0, distances)
    np.testing.assert_allclose(table, expected, atol=1e-5)
