"""What learned weights cost: against the features one by one, and sums worked out by hand."""

from typing import Any

import numpy as np
import pytest

from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.geometry import disc, rim
from mabirds_core.games.drones.learned_costs import (
    closeness_costs,
    distance_costs,
    measures,
    obstacle_costs,
    place_costs,
    trajectory_costs,
)
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.interface import Trajectories, Visitation

ARENA: dict[str, Any] = {
    "kind": "drones",
    "arena": (2.0, 1.5),
    "obstacles": [{"centre": (1.0, 0.7), "radius": 0.2}, {"centre": (2.0, 0.7), "radius": 0.2}],
    "drones": [
        {"start": (0.3, 0.2), "goal_region": {"centre": (1.6, 1.3), "radius": 0.2}},
        {"start": (1.4, 0.2), "goal_region": {"centre": (0.2, 1.2), "radius": 0.2}},
    ],
    "horizon": 3,
    "least_distance": 0.3,
    "features": {"cost_spacing": 0.5, "cost_width": 0.3, "distance_levels": (0.2, 0.5), "distance_scale": 2.0},
}
RNG = np.random.default_rng(7)


@pytest.fixture
def game() -> DroneGame:
    return DroneGame(DroneSettings.model_validate(ARENA))


@pytest.fixture
def omega(game: DroneGame) -> np.ndarray:
    return np.random.default_rng(1).normal(size=len(game.cost_features.names))


def by_features(game: DroneGame, omega: np.ndarray, places: np.ndarray) -> float:
    """-omega^T phi of one joint state at rest."""
    return float(-omega @ game.cost_features.total(Visitation(places.reshape(1, 4), np.zeros((1, 4)), np.ones(1))))


def test_costs_of_places_and_distances_add_up_to_those_of_the_features(game: DroneGame, omega: np.ndarray) -> None:
    for places in RNG.uniform(size=(20, 2, 2)) * game.arena:
        alone = sum(float(place_costs(game, omega, drone, places[drone])) for drone in range(2))
        together = float(distance_costs(game, omega, 0, np.hypot(*(places[0] - places[1]))))
        assert alone + together == pytest.approx(by_features(game, omega, places))


def test_costs_of_places_keep_their_shape(game: DroneGame, omega: np.ndarray) -> None:
    places = RNG.uniform(size=(3, 4, 2))
    found = place_costs(game, omega, 1, places)
    assert found.shape == (3, 4)
    assert found[2, 1] == pytest.approx(float(place_costs(game, omega, 1, places[2, 1])))


def test_a_disc_is_covered_evenly_and_a_rim_is_a_circle() -> None:
    centre, radius = (1.0, -2.0), 0.6
    away = disc(centre, radius, 2000) - centre
    np.testing.assert_allclose(away.mean(axis=0), 0, atol=1e-3)
    np.testing.assert_allclose((away**2).mean(axis=0), radius**2 / 4, rtol=1e-2)  # of a disc
    np.testing.assert_allclose((away[:, 0] ** 4).mean(), radius**4 / 8, rtol=1e-2)
    assert np.hypot(*away.T).max() < radius
    np.testing.assert_allclose(np.hypot(*(rim(centre, radius, 360) - centre).T), radius)


def test_costs_of_a_obstacle_are_means_over_the_places_that_a_drone_may_not_enter(
    game: DroneGame, omega: np.ndarray
) -> None:
    inside, border = obstacle_costs(game, omega)
    assert inside.shape == border.shape == (2, 2)
    grid = np.stack(np.meshgrid(*(np.linspace(0, side, 801) for side in game.arena)), axis=-1).reshape(-1, 2)
    keep = 0.2 + game.settings.drone_radius
    for obstacle, circle in enumerate(game.settings.obstacles):  # half of the second is outside the arena
        touching = grid[np.hypot(*(grid - circle.centre).T) < keep]
        angles = np.linspace(0, 2 * np.pi, 4001)
        around = np.column_stack([1.0 + obstacle + keep * np.cos(angles), 0.7 + keep * np.sin(angles)])
        around = around[around[:, 0] <= 2.0]
        for drone in range(2):
            assert inside[drone, obstacle] == pytest.approx(place_costs(game, omega, drone, touching).mean(), abs=5e-3)
            assert border[drone, obstacle] == pytest.approx(place_costs(game, omega, drone, around).mean(), abs=5e-3)


def test_ways_cost_what_their_places_cost_until_the_goal_region(game: DroneGame, omega: np.ndarray) -> None:
    ways = np.array(
        [[[0.3, 0.2], [0.9, 0.2], [1.5, 1.3], [1.6, 1.3]], [[1.4, 0.2], [0.9, 0.4], [0.9, 0.9], [0.2, 1.0]]]
    )
    rollouts = Trajectories(np.concatenate([ways[0], ways[1]], axis=1)[None], np.zeros((1, 4, 4)))
    first, second = trajectory_costs(game, omega, rollouts)
    assert first == pytest.approx(place_costs(game, omega, 0, ways[0, :2]).mean())  # the rest is within 0.2 m
    assert second == pytest.approx(place_costs(game, omega, 1, ways[1, :3]).mean())  # as is its last


def test_closeness_is_the_least_margin_over_a_large_distance(game: DroneGame) -> None:
    omega = np.zeros(len(game.cost_features.names))
    omega[-4:-2] = -1.0, -0.5
    # Costs fall with the distance, so that the cheapest too small one is the least distance itself.
    near, far = (2.0 * (1 / (1 + np.exp((d - 0.2) / 0.03)) + 0.5 / (1 + np.exp((d - 0.5) / 0.03))) for d in (0.3, 1.0))
    np.testing.assert_allclose(closeness_costs(game, omega), near - far)
    assert closeness_costs(game, -omega)[0] < 0
    assert closeness_costs(game, 0 * omega) == 0


def test_measures_are_costs_by_the_names_of_things(game: DroneGame) -> None:
    omega = RNG.normal(size=len(game.cost_features.names))
    states = game.starts(4, RNG)[:, None].repeat(game.horizon + 1, axis=1)
    shown = Trajectories(states, np.zeros((4, game.horizon + 1, game.action_size)))
    by_name = measures(game, omega, shown)
    inside, border = obstacle_costs(game, omega)
    demonstrated = trajectory_costs(game, omega, shown)
    for obstacle, place in enumerate(("(1, 0.7) m", "(2, 0.7) m")):
        for drone in range(2):
            name = f"{place}, drone {drone + 1}"
            assert by_name["obstacle_cost"][name] == inside[drone, obstacle]
            assert by_name["rim_cost"][name] == border[drone, obstacle]
            assert by_name["demonstrated_cost"][name] == demonstrated[drone]
            dearer = min(inside[drone, obstacle], border[drone, obstacle]) > demonstrated[drone]
            assert by_name["obstacle_dearer"][name] == float(dearer)
    (closeness,) = closeness_costs(game, omega)
    assert by_name["closeness_cost"] == {"drones 1 and 2": closeness}
    assert by_name["closeness_dearer"] == {"drones 1 and 2": float(closeness > 0)}
    assert {len(values) for values in by_name.values()} == {4, 1}
