"""Ways past obstacles: the lattice against an independent search, lengths against geometry, sides, and room to pass."""

from itertools import pairwise, product
from typing import Any

import networkx as nx
import numpy as np
import pytest

from mabirds_core.games.drones.flight_paths import (
    LEFT,
    RIGHT,
    FlightPaths,
    PathPlanner,
    band_smoother,
    length_of,
    resampled,
    shortest_way,
)
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.settings import DroneSettings

MARGIN, RADIUS = 0.05, 0.12
START, GOAL = (0.5, 3.0), (5.5, 3.0)

Circles = list[tuple[float, float, float]]


def planner(obstacles: Circles, **changes: Any) -> PathPlanner:
    """Of one drone that is to fly through an arena of 6 m x 6 m from the left to the right."""
    values: dict[str, Any] = {
        "kind": "drones",
        "arena": (6, 6),
        "obstacles": [{"centre": (x, y), "radius": radius} for x, y, radius in obstacles],
        "drones": [{"start": START, "start_spread": 0.2, "goal_region": {"centre": GOAL, "radius": 0.4}}],
        "drone_radius": RADIUS,
    }
    return PathPlanner(DroneGame(DroneSettings.model_validate(values | changes)), MARGIN)


def path(made: PathPlanner, side: int, clearance: float = 0.3, start: tuple[float, float] = START) -> np.ndarray:
    return made.paths(np.array([start]), np.array([GOAL]), [side], np.array([clearance])).points[0]


def gaps(way: np.ndarray, obstacles: Circles) -> np.ndarray:
    """Metres left to each obstacle, at many places of the way."""
    dense = np.concatenate([np.linspace(one, other, 20) for one, other in pairwise(way)])
    return np.array([np.hypot(*(dense - (x, y)).T).min() - radius - RADIUS for x, y, radius in obstacles])


@pytest.mark.parametrize("seed", range(20))
def test_a_shortest_way_is_as_short_as_an_independent_search_says(seed: int) -> None:
    free = np.random.default_rng(seed).random((9, 12)) < 0.65
    nodes = [tuple(node) for node in np.argwhere(free).tolist()]
    graph = nx.Graph()
    graph.add_nodes_from(nodes)
    for (x, y), dx, dy in product(nodes, (-1, 0, 1), (-1, 0, 1)):
        if (dx or dy) and (x + dx, y + dy) in graph:
            graph.add_edge((x, y), (x + dx, y + dy), weight=np.hypot(dx, dy))
    way = shortest_way(free, 0, len(nodes) - 1)
    if not nx.has_path(graph, nodes[0], nodes[-1]):
        assert way is None
        return
    assert way is not None
    assert (way[0], way[-1]) == (0, len(nodes) - 1)
    weights = [graph.edges[nodes[i], nodes[j]]["weight"] for i, j in pairwise(way)]
    assert sum(weights) == pytest.approx(nx.dijkstra_path_length(graph, nodes[0], nodes[-1]))


@pytest.mark.parametrize("side", [LEFT, RIGHT])
def test_the_way_around_one_obstacle_is_hardly_longer_than_tangents_and_arc(side: int) -> None:
    obstacles = [(3.0, 3.0, 0.8)]
    reach, distance = 0.8 + RADIUS + MARGIN, 2.5
    tangent, angle = np.sqrt(distance**2 - reach**2), np.pi - 2 * np.arccos(reach / distance)
    shortest = 2 * tangent + reach * angle
    corridor = planner(obstacles).corridors[0][side].points
    assert shortest <= length_of(corridor) <= 1.02 * shortest
    assert length_of(path(planner(obstacles), side, clearance=MARGIN)) == pytest.approx(shortest, rel=0.02)


@pytest.mark.parametrize(
    "obstacles",
    [
        [(3.0, 3.0, 0.6)],
        [(3.0, 2.6, 0.6)],  # left would be shorter
        [(3.0, 3.3, 0.6)],
        [(3.0, 3.7, 0.6)],  # from the lower starts there is a free view of the goal region
        [(3.0, 3.0, 0.6), (1.9, 4.1, 0.3), (4.2, 2.0, 0.3), (3.0, 5.2, 0.4), (3.1, 0.9, 0.4)],
    ],
)
def test_the_side_is_as_asked(obstacles: Circles) -> None:
    made = planner(obstacles)
    x, y, _ = obstacles[0]
    for side, start in product((LEFT, RIGHT), [(0.3, 2.8), (0.7, 3.2), START]):
        way = path(made, side, start=start)
        beside = np.interp(x, way[:, 0], way[:, 1])
        assert np.sign(beside - y) == side
        assert (gaps(way, obstacles) > 0).all()


@pytest.mark.parametrize("seed", range(10))
def test_the_side_is_as_asked_in_every_direction(seed: int) -> None:
    """Across an arena of 8 m x 8 m at any angle, past an obstacle beside the straight way: one side is shorter."""
    angle = np.random.default_rng(seed).uniform(0, 2 * np.pi)
    ahead, middle = np.array([np.cos(angle), np.sin(angle)]), np.array([4.0, 4.0])
    left = np.array([-ahead[1], ahead[0]])
    start, goal = middle - 2.5 * ahead, middle + 2.5 * ahead
    for side, shift in product((LEFT, RIGHT), (-0.5, 0.03, 0.5)):
        made = planner(
            [(*(middle + shift * left), 0.6)],
            arena=(8, 8),
            drones=[{"start": tuple(start), "goal_region": {"centre": tuple(goal), "radius": 0.4}}],
        )
        way = made.paths(start[None], goal[None], [side], np.array([0.3])).points[0] - middle
        assert np.sign(np.interp(0.0, way @ ahead, way @ left) - shift) == side


def test_in_arenas_full_of_obstacles_there_is_room_to_pass() -> None:
    """In random arenas: a way never touches an obstacle, and mostly keeps the margin."""
    rng, found, close = np.random.default_rng(3), 0, 0
    for _ in range(30):
        obstacles: Circles = []
        while len(obstacles) < 7:
            x, y, radius = *rng.uniform((1.3, 0.3), (4.7, 5.7)), rng.uniform(0.2, 0.5)
            if all(np.hypot(x - a, y - b) > radius + other + 0.7 for a, b, other in obstacles):
                obstacles.append((float(x), float(y), float(radius)))
        made = planner(obstacles)
        for side in made.corridors[0]:
            left = gaps(path(made, side), obstacles).min()
            found, close = found + 1, close + int(left < MARGIN)
            assert left > 0
    assert found >= 40
    assert close <= 0.05 * found


def test_more_clearance_leaves_more_room_and_a_way_is_smooth() -> None:
    obstacles = [(3.0, 3.0, 0.6)]
    ways = [path(planner(obstacles), LEFT, clearance) for clearance in (0.1, 0.3, 0.5)]
    left = [gaps(way, obstacles)[0] for way in ways]
    assert np.diff(left).min() > 0.1
    for way in ways:
        directions = np.unwrap(np.arctan2(*np.diff(way, axis=0).T[::-1]))
        assert np.abs(np.diff(directions)).max() < 0.3  # radians between points 0.15 m apart; a lattice turns by 0.8


def test_points_of_a_way_are_equally_far_apart_and_its_ends_stay() -> None:
    way = path(planner([(3.0, 3.0, 0.6)]), RIGHT)
    steps = np.hypot(*np.diff(way, axis=0).T)
    np.testing.assert_allclose(steps, steps.mean(), rtol=2e-3)
    np.testing.assert_allclose(way[[0, -1]], [START, GOAL], atol=1e-9)


def test_where_nothing_is_in_between_both_sides_are_the_straight_way() -> None:
    made = planner([(3.0, 1.0, 0.5)])
    for side in (LEFT, RIGHT):
        np.testing.assert_allclose(path(made, side)[:, 1], 3.0, atol=1e-9)


@pytest.mark.parametrize(("start", "obstacles"), [((1.5, 0.6), []), ((0.3, 5.5), [(3.0, 3.0, 0.6)])])
def test_with_a_free_view_of_the_goal_region_a_way_is_straight(start: tuple[float, float], obstacles: Circles) -> None:
    """From anywhere: it does not lead through the middle of the start."""
    offset, ahead = path(planner(obstacles), LEFT, start=start) - start, np.subtract(GOAL, start)
    np.testing.assert_allclose(ahead[0] * offset[:, 1] - ahead[1] * offset[:, 0], 0.0, atol=1e-9)


@pytest.mark.parametrize(("y", "side"), [(4.4, RIGHT), (1.6, LEFT)])
def test_a_side_that_the_wall_closes_is_none(y: float, side: int) -> None:
    made = planner([(3.0, y, 1.38)])  # at the wall 0.22 m are left, and a drone is 0.24 m wide
    assert set(made.corridors[0]) == {side}


def test_a_side_that_takes_too_long_is_none() -> None:
    """Left of the obstacle it is 5.7 m, right of it 7.4 m."""
    obstacles = [(3.0, 2.0, 1.5)]
    assert set(planner(obstacles).corridors[0]) == {LEFT, RIGHT}
    assert set(planner(obstacles, horizon=24).corridors[0]) == {LEFT}
    assert set(planner(obstacles, horizon=16).corridors[0]) == set()


def test_no_way_leads_through_a_wall_of_obstacles() -> None:
    wall = [(3.0, y, 0.3) for y in np.arange(0.25, 6.0, 0.5)]
    assert planner(wall).corridors == [{}]
    assert set(planner([*wall[:8], *wall[10:]]).corridors[0]) == {LEFT}


def test_the_side_of_a_start_is_that_of_the_straight_line() -> None:
    made = planner([])
    assert made.side_of(0, np.array([0.4, 3.1])) == LEFT
    assert made.side_of(0, np.array([0.6, 2.9])) == RIGHT


def test_a_place_along_a_way_is_where_the_way_has_that_length() -> None:
    corners = np.array([[0.0, 0.0], [3.0, 0.0], [3.0, 4.0]])
    paths = FlightPaths.through(np.stack([resampled(corners, 71), resampled(corners[::-1], 71)]))
    np.testing.assert_allclose(paths.lengths, 7.0)
    places = paths.at(np.array([[-1.0, 2.0, 3.5, 7.0, 9.0], [0.0, 2.0, 4.0, 6.5, 7.5]]))
    np.testing.assert_allclose(places[0], [[0, 0], [2, 0], [3, 0.5], [3, 4], [3, 4]], atol=1e-9)
    np.testing.assert_allclose(places[1], [[3, 4], [3, 2], [3, 0], [0.5, 0], [0, 0]], atol=1e-9)


def test_a_way_of_no_length_is_one_place() -> None:
    paths = FlightPaths.through(np.ones((1, 24, 2)))
    np.testing.assert_array_equal(paths.at(np.array([[0.0, 1.0]])), np.ones((1, 2, 2)))


def test_a_straight_band_stays_and_a_bent_one_gets_shorter() -> None:
    smoother = band_smoother(30)
    straight = np.linspace((0.0, 1.0), (3.0, 2.0), 30)
    np.testing.assert_allclose(smoother @ straight, straight, atol=1e-9)
    bent = straight + np.outer(np.sin(np.linspace(0, np.pi, 30)), (-0.3, 0.9))
    lengths = [length_of(np.linalg.matrix_power(smoother, times) @ bent) for times in (0, 5, 50, 5000)]
    assert (np.diff(lengths) < 0).all()
    assert lengths[-1] == pytest.approx(np.sqrt(10))
