"""Walls as segments and polygons: distances against points along them, and what drones may and pilots can do."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from matplotlib.path import Path as Polygon
from pydantic import ValidationError

from mabirds_core.games.drones.geometry import segment_distance
from mabirds_core.games.drones.pilots import Pilots
from mabirds_core.games.drones.regions import Obstacle, inside
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.whole_game import WholeDroneGame
from mabirds_core.games.interface import Trajectories

ROOM = {
    "kind": "drones",
    "arena": (4.0, 3.0),
    "walls": [[(2.0, 0.0), (2.0, 1.8)]],
    "drones": [{"start": (0.6, 0.6), "start_spread": 0.1, "goal_region": {"centre": (3.4, 0.6), "radius": 0.3}}],
    "horizon": 30,
    "drone_radius": 0.1,
}
HUT = [(1.0, 1.0), (2.2, 1.0), (2.2, 2.0), (1.0, 2.0), (1.0, 1.0)]

places = st.tuples(st.floats(-3, 3), st.floats(-3, 3)).map(np.array)


def room(**changes: object) -> WholeDroneGame:
    return WholeDroneGame(DroneSettings.model_validate({**ROOM, **changes}))


@given(start=places, end=places, first=places, second=places)
def test_segments_are_as_far_apart_as_their_nearest_points(
    start: np.ndarray, end: np.ndarray, first: np.ndarray, second: np.ndarray
) -> None:
    along = np.linspace(0, 1, 301)[:, None]
    one, other = start + along * (end - start), first + along * (second - first)
    nearest = np.sqrt(((one[:, None] - other) ** 2).sum(axis=-1)).min()
    step = max(np.hypot(*(end - start)), np.hypot(*(second - first))) / 300
    found = float(segment_distance(start, end, first, second))
    assert nearest - step <= found <= nearest + 1e-12


def test_places_and_outline_of_a_wall_are_on_it() -> None:
    wall = Obstacle(centre=(1.0, 1.0), until=(2.0, 3.0), radius=0.2)
    away = np.sqrt(wall.away(wall.places(0.1, 4000)))
    assert away.max() <= 0.3
    rim = wall.outline(0.1, 400)
    np.testing.assert_allclose(np.sqrt(wall.away(rim)), 0.3, rtol=0, atol=1e-12)
    steps = np.hypot(*(np.roll(rim, -1, axis=0) - rim).T)
    assert steps.max() == pytest.approx((2 * np.sqrt(5) + 2 * np.pi * 0.3) / 400, rel=1e-3)  # evenly, all around
    assert (np.diff(wall.centres(0.3)[:, 0]) * np.sqrt(5) <= 0.3).all()
    np.testing.assert_array_equal(wall.centres(0.3)[[0, -1]], [(1.0, 1.0), (2.0, 3.0)])


def test_inside_is_what_matplotlib_says() -> None:
    star = np.array([(0, 0), (3, 0.5), (2, 2), (2.5, 3), (1, 1.5), (-1, 2.5)], dtype=float)
    points = np.random.default_rng(0).uniform(-2, 4, (5000, 2))
    np.testing.assert_array_equal(inside(star, points), Polygon(star).contains_points(points))


def test_whoever_flies_through_a_wall_between_two_steps_violates() -> None:
    game = room(max_speed=4.0)
    states = np.repeat([[1.6, 0.9]], 31, axis=0)
    for after, violates in (((2.4, 0.9), True), ((1.6, 2.0), False), ((1.95, 0.9), True)):
        states[1:] = after
        assert bool(game.violates(Trajectories(states[None], np.zeros((1, 31, 2))))[0]) is violates


def test_what_closed_walls_surround_is_forbidden() -> None:
    game, open_ = room(walls=[HUT]), room(walls=[HUT[:-1]])
    nodes = game.cost_features.grid.nodes
    middle = np.hypot(*(nodes - (1.6, 1.5)).T).argmin()
    constraints, without = game.true_constraints, open_.true_constraints
    assert constraints is not None
    assert without is not None
    assert constraints[middle]
    assert not without[middle]
    assert game.scene.forbidden.sum() > open_.scene.forbidden.sum()


def test_pilots_fly_round_a_wall() -> None:
    game = room()
    for demonstration in Pilots(game, "by_start").demonstrations(3, np.random.default_rng(1)):
        assert not game.violates(demonstration).any()
        assert demonstration.states[0, :, 1].max() > 1.8  # through the gap


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"walls": [[(0.6, 0.0), (0.6, 3.0)]]}, r"start of drone 1 touches the wall to .0.6, 3.0. that begins at"),
        ({"walls": [[(0.75, 0.0), (0.75, 3.0)]]}, "expected 0.11 m between"),
        ({"walls": [[(1.0, 1.0)]]}, "expected two corners or more"),
        ({"walls": [[(1.0, 1.0), (1.0, 1.0)]]}, "no two alike one after the other"),
        ({"obstacles": [{"centre": (1.0, 1.0), "until": (1.0, 1.0), "radius": 0.1}]}, "expected another place"),
    ],
)
def test_walls_that_cannot_be_are_refused(changes: dict[str, object], words: str) -> None:
    with pytest.raises(ValidationError, match=words):
        room(**changes)
