"""Swept distances, violations and arrivals against rollouts that are sampled densely."""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
import pytest
from arenas import arena, double, joint, random_rollouts
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.arrays import Array
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.geometry import closest_approach, swept_distance, swept_separation
from mabirds_core.games.drones.regions import Obstacle
from mabirds_core.games.interface import Trajectories

SAMPLES = np.linspace(0, 1, 2001)

numbers = st.one_of(st.floats(-10, 10), st.integers(-3, 3).map(float))
points = st.tuples(numbers, numbers).map(np.array)


def along(start: Array, end: Array) -> Array:
    """Places on the way, shape (samples, 2)."""
    return start + SAMPLES[:, None] * (end - start)


def assert_least(found: float, sampled: Array) -> None:
    """``found`` is at most the sampled distances, and no smaller than their spacing lets the least one be."""
    slack = 0.5 * np.abs(np.diff(sampled)).max() + 1e-6
    assert sampled.min() - slack <= found <= sampled.min() + 1e-9


@given(points, points, points)
def test_the_distance_to_a_point_is_the_least_of_those_on_the_way(start: Array, end: Array, centre: Array) -> None:
    sampled = np.hypot(*(along(start, end) - centre).T)
    assert_least(float(swept_distance(start, end, centre)), sampled)


@given(points, points, points, points)
def test_the_separation_is_the_least_at_equal_times(a: Array, a_end: Array, b: Array, b_end: Array) -> None:
    sampled = np.hypot(*(along(a, a_end) - along(b, b_end)).T)
    assert_least(float(swept_separation((a, b), (a_end, b_end))), sampled)


@given(points, points)
def test_a_rollout_backwards_comes_as_close(start: Array, end: Array) -> None:
    assert float(closest_approach(start, end)) == pytest.approx(float(closest_approach(end, start)), abs=1e-9)


@pytest.mark.parametrize(
    ("start", "end", "least"),
    [
        ((3, 4), (3, 4), 5),  # a drone at rest
        ((0, 0), (0, 0), 0),
        ((-1, 2), (1, 2), 2),  # closest on the way
        ((1, 1), (4, 5), np.sqrt(2)),  # at the start
        ((4, 5), (1, 1), np.sqrt(2)),  # at the end
        ((-2, -2), (2, 2), 0),  # through the point
        ((1, 0), (1, 1e-200), 1),  # a way whose square is none
    ],
)
def test_distances_by_hand(start: tuple[float, float], end: tuple[float, float], least: float) -> None:
    assert float(closest_approach(np.array(start, float), np.array(end, float))) == pytest.approx(least, abs=1e-15)


def test_many_segments_are_each_judged_alone() -> None:
    starts, ends = np.random.default_rng(0).normal(size=(2, 4, 5, 2))
    found = closest_approach(starts, ends)
    assert found.shape == (4, 5)
    for index in np.ndindex(4, 5):
        assert found[index] == closest_approach(starts[index], ends[index])


def test_a_obstacle_that_is_jumped_over_between_two_steps_is_seen() -> None:
    """The steps are 0.35 m left and right of an obstacle of 0.15 m for a drone of 0.1 m: only the way touches it."""
    game = arena(1, {"horizon": 1, "time_step": 1.0})
    states = np.array([[[0.45, 0.6], [1.15, 0.6]]])
    rollout = Trajectories(states, np.array([[[0.7, 0.0], [0.0, 0.0]]]))
    assert game.obstacle_clearance(states)[0, 0, 0] == pytest.approx(-0.25)
    assert game.violates(rollout).tolist() == [True]


def test_drones_that_swap_places_between_two_steps_have_met() -> None:
    game = arena(2, {"obstacles": []})
    states = joint(np.array([[[[0.2, 0.2], [1.0, 0.2]], [[1.0, 0.2], [0.2, 0.2]]]]))
    assert game.separation_clearance(states)[0, 0] == pytest.approx(-0.3)
    past = joint(np.array([[[[0.2, 0.2], [1.0, 0.6]], [[1.0, 0.2], [0.2, 0.6]]]]))
    assert game.separation_clearance(past)[0, 0] == pytest.approx(0.4 - 0.3)


def test_touching_is_not_yet_too_close() -> None:
    """Clearances of exactly zero break nothing; numbers are powers of two, so that nothing is rounded."""
    game = arena(
        1,
        {
            "obstacles": [{"centre": (1.0, 0.5), "radius": 0.25}],
            "drone_radius": 0.25,
            "drones.0.goal_region.radius": 0.1,
        },
    )
    states = np.array([[[0.5, 0.0], [0.5, 1.0]]])
    assert game.obstacle_clearance(states)[0, 0, 0] == 0
    assert not game.violates(Trajectories(states, states)).any()


def clearance(game: DroneGame, way: Array) -> float:
    """The least distance to what may not be touched, over places (steps, N_E, 2) of the drones."""
    s = game.settings
    obstacles = [
        np.hypot(*(way[:, i] - obstacle.centre).T).min() - obstacle.radius - s.drone_radius
        for i in range(s.n_experts)
        for obstacle in s.obstacles
    ]
    others = [
        np.hypot(*(way[:, i] - way[:, j]).T).min() - s.least_distance for i in range(s.n_experts) for j in range(i)
    ]
    return float(min([*obstacles, *others]))


def dense_clearance(game: DroneGame, rollout: Array) -> float:
    """The same on the ways between the steps of a rollout (T + 1, N_E, 2)."""
    shares = np.linspace(0, 1, 101)[:, None, None]
    return clearance(game, np.concatenate([a + shares * (b - a) for a, b in pairwise(rollout)]))


SWIFT = {
    "obstacles": [{"centre": (0.8, 0.6), "radius": 0.05}],
    "drone_radius": 0.05,
    "least_distance": 0.2,
    "max_speed": 4.0,
    "max_acceleration": 8.0,
    "horizon": 3,
}
"""Small obstacles and long steps: many rollouts touch something between two steps alone."""


@pytest.mark.parametrize("make", [arena, double])
@pytest.mark.parametrize("drones", [1, 2, 3])
def test_verdicts_are_those_of_densely_sampled_rollouts(make: Callable[..., DroneGame], drones: int) -> None:
    game = make(drones, {**SWIFT, "horizon": 6, **{f"drones.{i}.goal_region.radius": 0.8 for i in range(drones)}})
    rollouts = random_rollouts(game, 300)
    places = game.positions(rollouts.states)
    kept = np.array([dense_clearance(game, one) for one in places])
    home = [
        all(np.hypot(*(one[-1, i] - region.centre)) <= region.radius for i, region in enumerate(goal_regions(game)))
        for one in places
    ]
    clear = np.abs(kept) > 5e-3
    assert clear.mean() > 0.9
    np.testing.assert_array_equal(game.violates(rollouts)[clear], kept[clear] < 0)
    np.testing.assert_array_equal(game.succeeds(rollouts)[clear], (home & (kept > 0))[clear])
    assert 0 < (kept < 0).mean() < 1
    assert 0 < (home & (kept > 0)).mean() < 1


def goal_regions(game: DroneGame) -> list[Obstacle]:
    return [task.goal_region for task in game.settings.drones]


@pytest.mark.parametrize("make", [arena, double])
def test_many_rollouts_pass_an_obstacle_between_their_steps_alone(make: Callable[..., DroneGame]) -> None:
    """Otherwise the test above would not tell swept distances from those at the steps."""
    game = make(2, SWIFT)
    rollouts = random_rollouts(game, 300)
    at_steps = np.array([clearance(game, one) for one in game.positions(rollouts.states)])
    assert (game.violates(rollouts) & (at_steps > 0.01)).mean() > 0.02


def test_without_obstacles_and_others_there_is_nothing_to_break() -> None:
    game = arena(1, {"obstacles": []})
    rollouts = random_rollouts(game, 3)
    assert np.isposinf(game.obstacle_clearance(rollouts.states)).all()
    assert np.isposinf(game.separation_clearance(rollouts.states)).all()
    assert not game.violates(rollouts).any()


def test_arriving_after_a_violation_is_no_success() -> None:
    game = arena(
        1, {"drones.0.start": (0.3, 0.6), "drones.0.goal_region.centre": (1.3, 0.6), "horizon": 2, "time_step": 0.5}
    )
    touching = np.array([[[0.3, 0.6], [0.9, 0.6], [1.3, 0.6]]])
    around = np.array([[[0.3, 0.6], [0.7, 1.1], [1.3, 0.6]]])
    late = np.array([[[0.3, 0.6], [0.4, 1.1], [0.9, 1.1]]])
    rollouts = Trajectories(np.concatenate([touching, around, late]), np.zeros((3, 3, 2)))
    assert game.violates(rollouts).tolist() == [True, False, False]
    assert game.succeeds(rollouts).tolist() == [False, True, False]
