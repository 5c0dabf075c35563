"""Pilots' demonstrations, judged by dense sampling of the trajectories and by recursions written anew."""

import re
from collections.abc import Sequence
from itertools import combinations, pairwise
from typing import Any

import numpy as np
import pytest

from mabirds_core.errors import InfeasibleError
from mabirds_core.experiment.file import PassingSide
from mabirds_core.games.drones.flight_paths import LEFT, RIGHT
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.pilots import (
    ATTEMPTS,
    INTENTIONS,
    PERSISTENCE,
    Pilots,
    correlated_noise,
)
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.interface import Trajectories

OBSTACLES = [((3.0, 3.0), 0.6), ((0.9, 3.0), 0.35), ((5.1, 3.0), 0.35), ((3.0, 0.6), 0.35), ((3.0, 5.4), 0.35)]
TASKS = [((0.6, 0.6), (5.5, 5.5)), ((5.4, 0.6), (0.5, 5.5))]
SPREAD, GOAL_RADIUS = 0.3, 0.4


def game(
    tasks: Sequence[Any] = TASKS, obstacles: Sequence[Any] = OBSTACLES, spread: float = SPREAD, **changes: Any
) -> DroneGame:
    drones = [
        {"start": start, "start_spread": spread, "goal_region": {"centre": goal, "radius": GOAL_RADIUS}}
        for start, goal in tasks
    ]
    circles = [{"centre": centre, "radius": radius} for centre, radius in obstacles]
    values = {"kind": "drones", "arena": (6, 6), "obstacles": circles, "drones": drones, **changes}
    return DroneGame(DroneSettings.model_validate(values))


def drawn(pilots: Pilots, count: int, seed: int = 0) -> list[Trajectories]:
    return list(pilots.demonstrations(count, np.random.default_rng(seed)))


def places(played: DroneGame, trajectory: Trajectories) -> np.ndarray:
    """Shape (T + 1, N_E, 2)."""
    size = played.state_size // played.n_experts
    return trajectory.states[0].reshape(-1, played.n_experts, size)[..., :2]


def dense(way: np.ndarray) -> np.ndarray:
    """Where drones (T + 1, N_E, 2) are from step to step, sampled often."""
    parts = np.linspace(0, 1, 41)[:, None, None]
    return np.concatenate([(1 - parts) * one + parts * other for one, other in pairwise(way)])


def at_goal(played: DroneGame, trajectory: Trajectories) -> np.ndarray:
    """Shape (T + 1, N_E)."""
    goals = np.array([task.goal_region.centre for task in played.settings.drones])
    return np.hypot(*np.moveaxis(places(played, trajectory) - goals, -1, 0)) <= GOAL_RADIUS


def arrivals(played: DroneGame, trajectory: Trajectories) -> np.ndarray:
    """First step in the goal region, shape (N_E,); T + 1 for drones that never are."""
    return (~at_goal(played, trajectory)).sum(axis=0)


def side_taken(way: np.ndarray, start: tuple[float, float], goal: tuple[float, float]) -> int:
    """LEFT or RIGHT of the obstacle in the middle of the arena."""
    offset = way - (3.0, 3.0)
    x, y = offset[np.hypot(*offset.T).argmin()]
    ahead = np.subtract(goal, start)
    return LEFT if ahead[0] * y - ahead[1] * x > 0 else RIGHT


def sides_taken(played: DroneGame, trajectory: Trajectories) -> list[int]:
    way = places(played, trajectory)
    return [side_taken(way[:, drone], *TASKS[drone]) for drone in range(played.n_experts)]


CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {
    "by start": ({"side": "by_start"}, {}),
    "random": ({}, {}),
    "careless": ({"clearance": (0.15, 0.3), "yield_margin": 0.1}, {}),
    "one drone": ({}, {"tasks": TASKS[:1]}),
    "double integrators": ({}, {"dynamics": "double_integrator"}),
    "slow double integrators": ({"side": "by_start"}, {"dynamics": "double_integrator", "max_acceleration": 0.7}),
    "three drones, no obstacles": ({}, {"tasks": [*TASKS, ((0.6, 3.0), (5.5, 3.0))], "obstacles": [], "horizon": 50}),
    "fast and fine steps": ({}, {"time_step": 0.1, "horizon": 70, "max_speed": 1.5}),
}
"""What differs in pilots and in their game."""
COUNT = {"by start": 100, "random": 100}


@pytest.fixture(scope="module", params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[DroneGame, list[Trajectories]]:
    ways, changes = CASES[request.param]
    played = game(**changes)
    return played, drawn(Pilots(played, **({"side": "random"} | ways)), COUNT.get(request.param, 30))


def test_no_trajectory_violates_anything(case: tuple[DroneGame, list[Trajectories]]) -> None:
    played, trajectories = case
    assert len(trajectories) >= 30
    for trajectory in trajectories:
        way = dense(places(played, trajectory))
        for obstacle in played.settings.obstacles:
            distance = np.hypot(*np.moveaxis(way - obstacle.centre, -1, 0))
            assert distance.min() >= obstacle.radius + 0.12 + Pilots.margin - 1e-9
        for i, j in combinations(range(played.n_experts), 2):
            assert np.hypot(*(way[:, i] - way[:, j]).T).min() >= 0.35 + Pilots.margin - 1e-9


def test_all_arrive_and_then_do_nothing(case: tuple[DroneGame, list[Trajectories]]) -> None:
    played, trajectories = case
    for trajectory in trajectories:
        there = at_goal(played, trajectory)
        assert there[-1].all()
        controls = trajectory.actions[0].reshape(*there.shape, 2)
        assert (controls[there] == 0).all()
        assert (np.hypot(*controls[~there].T) > 0).all()


def test_drones_move_as_their_dynamics_say_and_no_faster_than_allowed(
    case: tuple[DroneGame, list[Trajectories]],
) -> None:
    played, trajectories = case
    settings = played.settings
    for trajectory in trajectories:
        way, there = places(played, trajectory), at_goal(played, trajectory)
        controls = trajectory.actions[0].reshape(way.shape).copy()
        velocities = np.diff(way, axis=0) / settings.time_step
        assert np.hypot(*np.moveaxis(velocities, -1, 0)).max() <= settings.max_speed + 1e-9
        assert np.hypot(*np.moveaxis(controls, -1, 0)).max() <= played.dynamics.max_action + 1e-9
        if settings.dynamics == "double_integrator":
            before = np.concatenate([np.zeros((1, *velocities.shape[1:])), velocities[:-1]])
            controls[:-1] = before + settings.time_step * controls[:-1]
        np.testing.assert_allclose(velocities[~there[:-1]], controls[:-1][~there[:-1]], atol=1e-9)


def test_the_game_takes_each_demonstration_back(case: tuple[DroneGame, list[Trajectories]]) -> None:
    played, trajectories = case
    for trajectory in trajectories:
        assert trajectory.states.shape == (1, played.horizon + 1, played.state_size)
        again = played.decode(*played.encode(trajectory))
        np.testing.assert_array_equal(again.states, trajectory.states)
        np.testing.assert_array_equal(again.actions, trajectory.actions)


def test_the_same_seed_makes_the_same_bytes_and_another_one_others() -> None:
    def data(seed: int) -> list[bytes]:
        # A planner of its own each time: nothing that was kept may matter.
        return [
            trajectory.states.tobytes() + trajectory.actions.tobytes()
            for trajectory in drawn(Pilots(game(), "random"), 5, seed)
        ]

    assert data(4) == data(4)
    assert not set(data(4)) & set(data(5))


def test_by_start_the_side_follows_from_the_start() -> None:
    played = game()
    trajectories, seen = drawn(Pilots(played, "by_start"), 80), set()
    for trajectory in trajectories:
        for drone, (start, goal) in enumerate(TASKS):
            offset, ahead = places(played, trajectory)[0, drone] - start, np.subtract(goal, start)
            expected = LEFT if ahead[0] * offset[1] - ahead[1] * offset[0] > 0 else RIGHT
            assert sides_taken(played, trajectory)[drone] == expected
            seen.add((drone, expected))
    assert len(seen) == 4


def test_random_sides_are_even_and_independent_even_from_one_start() -> None:
    """Four pairs of sides are equally likely: each count is within four standard deviations."""
    played = game(spread=0.0)
    taken = [tuple(sides_taken(played, trajectory)) for trajectory in drawn(Pilots(played, "random"), 120)]
    for pair in [(LEFT, LEFT), (LEFT, RIGHT), (RIGHT, LEFT), (RIGHT, RIGHT)]:
        assert abs(taken.count(pair) - 30) <= 4 * np.sqrt(120 * 3 / 16)


def test_one_start_by_start_is_one_side() -> None:
    played = game(spread=0.0)
    assert len({tuple(sides_taken(played, trajectory)) for trajectory in drawn(Pilots(played, "by_start"), 30)}) == 1


def test_where_one_side_is_closed_all_take_the_other() -> None:
    """Between the obstacle in the middle and the wall to the left of drone 1 there is no gap."""
    played = game(TASKS[:1], [((3.0, 3.0), 0.6), ((2.0, 4.0), 0.6), ((1.0, 5.0), 0.9)])
    sides: list[PassingSide] = ["by_start", "random", "left"]
    for side in sides:
        for trajectory in drawn(Pilots(played, side), 20):
            assert sides_taken(played, trajectory) == [RIGHT]


@pytest.mark.parametrize(("side", "expected"), [("left", LEFT), ("right", RIGHT)])
def test_all_pass_on_the_side_that_is_given(side: PassingSide, expected: int) -> None:
    played = game()
    for trajectory in drawn(Pilots(played, side), 20):
        assert sides_taken(played, trajectory) == [expected, expected]


def test_starts_are_drawn_once_a_demonstration(monkeypatch: pytest.MonkeyPatch) -> None:
    """Trajectories are drawn again from the same start: starts have the distribution of the game."""
    played = game()
    starts = []
    original = played.starts

    def noted(count: int, rng: np.random.Generator) -> np.ndarray:
        starts.append(original(count, rng))
        return starts[-1]

    monkeypatch.setattr(played, "starts", noted)
    trajectories = drawn(Pilots(played, "random"), 100)
    assert len(starts) == 100
    for start, trajectory in zip(starts, trajectories, strict=True):
        np.testing.assert_array_equal(start[0], trajectory.states[0, 0])


def test_pilots_differ_in_speed_and_in_their_ways() -> None:
    played = game()
    trajectories = drawn(Pilots(played, "by_start", cruise=(0.8, 1.0)), 60)
    times = np.array([arrivals(played, trajectory) for trajectory in trajectories])
    assert all(len(set(times[:, drone])) >= 6 for drone in range(2))
    assert (times.std(axis=0) >= 2).all()


def test_pilots_differ_in_the_distance_that_they_keep() -> None:
    played = game()
    steady, varied = (Pilots(played, "by_start", noise=0.0, clearance=(low, 0.5)) for low in (0.5, 0.2))
    least = [
        [np.hypot(*(dense(places(played, trajectory))[:, 0] - (3.0, 3.0)).T).min() for trajectory in drawn(pilots, 40)]
        for pilots in (steady, varied)
    ]
    assert np.std(least[0]) < 0.02
    assert np.std(least[1]) > 0.05
    assert np.mean(least[1]) < np.mean(least[0]) - 0.05


def test_trajectories_are_smooth() -> None:
    """Under way, no step turns by more than 40 degrees; noise of one step that is not of the next would."""
    played = game()
    for trajectory in drawn(Pilots(played, "random"), 40):
        velocities = np.diff(places(played, trajectory), axis=0)
        for drone, end in enumerate(arrivals(played, trajectory)):
            under_way = velocities[1:end, drone]
            quick = np.hypot(*under_way.T) > 0.1  # 0.4 m/s
            turns = np.diff(np.unwrap(np.arctan2(under_way[:, 1], under_way[:, 0])))
            assert np.abs(turns[quick[1:] & quick[:-1]]).max() < np.radians(40)


def trajectories_of(pilots: Pilots, seeds: range) -> list[Trajectories]:
    """One trajectory a seed, whether acceptable or not."""
    trajectories = []
    for seed in seeds:
        rng = np.random.default_rng(seed)
        trajectories.append(pilots._trajectory(pilots._intention(rng), rng))
    return trajectories


def separations(played: DroneGame, trajectories: list[Trajectories]) -> np.ndarray:
    """Closest approach of the two drones in each trajectory [m]."""
    ways = [dense(places(played, trajectory)) for trajectory in trajectories]
    return np.array([np.hypot(*(way[:, 0] - way[:, 1]).T).min() for way in ways])


def test_pilots_yield() -> None:
    """The same starts, sides, speeds and noise: those who do not look collide, those who do arrive later instead."""
    played = game()
    looking = trajectories_of(Pilots(played, "random"), range(80))
    blind = trajectories_of(Pilots(played, "random", foresight=0.0), range(80))
    for one, other in zip(looking, blind, strict=True):
        np.testing.assert_array_equal(one.states[0, 0], other.states[0, 0])
    colliding = separations(played, blind) < 0.35
    assert colliding.mean() > 0.25
    assert (separations(played, looking) > 0.4).all()
    late = np.array(
        [arrivals(played, pair[0]) - arrivals(played, pair[1]) for pair in zip(looking, blind, strict=True)]
    )
    assert (late >= 0).all()
    assert (late == 0).any(axis=1).all()  # one of the two flies on
    assert (late[colliding] > 0).any(axis=1).mean() > 0.9
    assert ((late > 0).mean(axis=0) > 0.1).all()  # who yields is drawn


def test_those_who_meet_nobody_do_not_yield() -> None:
    apart = game([((0.6, 0.6), (0.6, 5.4)), ((5.4, 0.6), (5.4, 5.4))], [])
    for one, other in zip(
        trajectories_of(Pilots(apart, "random"), range(10)),
        trajectories_of(Pilots(apart, "random", foresight=0.0), range(10)),
        strict=True,
    ):
        np.testing.assert_array_equal(one.states, other.states)


@pytest.mark.parametrize("side", ["by_start", "random", "left", "right"])
def test_most_trajectories_are_accepted(side: Any) -> None:
    pilots = Pilots(game(), side)
    assert np.mean([pilots._fault(trajectory) is None for trajectory in trajectories_of(pilots, range(80))]) >= 0.75


def test_with_plenty_of_acceleration_double_integrators_fly_like_single_ones() -> None:
    single, double = game(), game(dynamics="double_integrator", max_acceleration=1000.0)
    for one, other in zip(
        trajectories_of(Pilots(single, "random"), range(10)),
        trajectories_of(Pilots(double, "random"), range(10)),
        strict=True,
    ):
        np.testing.assert_allclose(places(double, other), places(single, one), atol=1e-9)


def test_noise_has_variance_one_and_persists() -> None:
    noise = correlated_noise(50_000, 1, np.random.default_rng(1))[:, 0]
    np.testing.assert_allclose(noise.std(axis=0), 1.0, atol=0.03)
    for axis in noise.T:
        assert np.corrcoef(axis[1:], axis[:-1])[0, 1] == pytest.approx(PERSISTENCE, abs=0.02)


def test_without_noise_pilots_still_differ() -> None:
    played = game(spread=0.0)
    trajectories = drawn(Pilots(played, "by_start", noise=0.0), 5)
    assert len({trajectory.states.tobytes() for trajectory in trajectories}) == 5


def test_a_wall_of_obstacles_is_infeasible() -> None:
    wall = game(obstacles=[((x, 3.0), 0.3) for x in np.arange(0.25, 6, 0.5).tolist()])
    expected = (
        "drone 1 has no way to its goal region that leaves 0.05 m to the obstacles and takes at most 40 steps of 0.25 s"
        " at 1 m/s; move the obstacles, the start or the goal region, or raise the horizon"
    )
    with pytest.raises(InfeasibleError, match=re.escape(expected)):
        drawn(Pilots(wall, "random", margin=0.05), 1)


def test_a_horizon_that_is_too_short_is_infeasible() -> None:
    with pytest.raises(InfeasibleError, match="takes at most 20 steps"):
        drawn(Pilots(game(horizon=20), "by_start"), 1)


def test_drones_that_start_too_close_to_each_other_are_infeasible() -> None:
    """0.38 m apart: the game allows that, the pilots' margin does not."""
    close = game([((1.0, 0.6), (5.5, 5.5)), ((1.38, 0.6), (0.5, 5.5))], [], spread=0.0)
    expected = (
        f"none of {INTENTIONS * ATTEMPTS} trajectories will do as a demonstration: 200 came too near to each other;"
    )
    with pytest.raises(InfeasibleError, match=re.escape(expected)):
        drawn(Pilots(close, "random", margin=0.05), 1)
    assert len(drawn(Pilots(close, "random", margin=0.01), 1)) == 1
