"""How drones fly, against closed forms and the rules written once more; starts; rollouts; decoding."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from arenas import RandomPilot, SlowArena, arena, double, joint, random_rollouts

from mabirds_core.arrays import Array
from mabirds_core.errors import ImpossibleTrajectoryError
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.rollouts import drone_rollouts

make_either = pytest.mark.parametrize("make", [arena, double])
HALL = {
    "arena": (100.0, 50.0),
    "obstacles": [],
    "drones.0.goal_region.centre": (99.0, 49.0),
    "drones.0.start": (20.0, 20.0),
}
"""So large that nothing is in the way."""


def fly(game: DroneGame, start: Array, actions: Array) -> Array:
    """States at every step, the first included, shape (steps + 1, N_E D)."""
    states = [start]
    for action in actions:
        states.append(game.step(states[-1][None], action[None])[0])
    return np.array(states)


def test_a_single_integrator_flies_straight_at_its_velocity() -> None:
    game = arena(1, HALL)
    states = fly(game, np.array([20.0, 20.0]), np.tile([0.6, -0.8], (40, 1)))
    np.testing.assert_allclose(states, [20, 20] + 0.25 * np.arange(41)[:, None] * [0.6, -0.8], rtol=0, atol=1e-12)


def test_a_double_integrator_sums_its_constant_acceleration() -> None:
    """v_k = k dt a, p_k = p_0 + dt (v_1 + ... + v_k) = p_0 + dt^2 a k (k + 1) / 2."""
    game, a, k = double(1, {**HALL, "max_speed": 100.0}), np.array([0.3, 0.4]), np.arange(31)[:, None]
    states = fly(game, np.array([20.0, 20.0, 0.0, 0.0]), np.tile(a, (30, 1)))
    np.testing.assert_allclose(states[:, 2:], k * 0.25 * a, rtol=0, atol=1e-12)
    np.testing.assert_allclose(states[:, :2], [20, 20] + 0.25**2 * a * k * (k + 1) / 2, rtol=0, atol=1e-11)


def test_without_acceleration_a_double_integrator_keeps_its_velocity() -> None:
    game = double(1, HALL)
    states = fly(game, np.array([20.0, 20.0, -0.5, 1.0]), np.zeros((8, 2)))
    np.testing.assert_array_equal(states[:, 2:], np.tile([-0.5, 1.0], (9, 1)))
    np.testing.assert_allclose(states[-1, :2], [20 - 0.5 * 2, 20 + 1.0 * 2], rtol=0, atol=1e-12)


def test_longer_actions_are_shortened_in_their_direction() -> None:
    single, heavy = arena(1, HALL), double(1, {**HALL, "max_speed": 100.0})
    here = np.array([[20.0, 20.0]])
    after = single.step(here, np.array([[3e5, -4e5]]))
    np.testing.assert_allclose(after, here + 0.25 * 1.2 * np.array([[0.6, -0.8]]), rtol=0, atol=1e-12)
    after = heavy.step(np.array([[20.0, 20.0, 0.0, 0.0]]), np.array([[3e5, -4e5]]))
    np.testing.assert_allclose(after[:, 2:], 0.25 * 2.5 * np.array([[0.6, -0.8]]), rtol=0, atol=1e-12)


def test_the_speed_of_a_double_integrator_is_limited_and_its_direction_kept() -> None:
    game = double(1, HALL)
    states = fly(game, np.array([20.0, 20.0, 0.0, 0.0]), np.tile([1.5, 2.0], (10, 1)))
    speeds = np.hypot(*states[:, 2:].T)
    np.testing.assert_allclose(speeds, np.minimum(np.arange(11) * 0.25 * 2.5, 1.2), rtol=0, atol=1e-12)
    np.testing.assert_allclose(states[-1, 2:], [0.6 * 1.2, 0.8 * 1.2], rtol=0, atol=1e-12)


@make_either
def test_no_step_is_longer_than_the_largest_speed_allows(make: Callable[..., DroneGame]) -> None:
    game = make(3, {"horizon": 20})
    places = game.positions(drone_rollouts(game, RandomPilot(game, longest=5), 50, np.random.default_rng(0)).states)
    lengths = np.hypot(*np.moveaxis(np.diff(places, axis=1), -1, 0))
    assert lengths.max() == pytest.approx(0.25 * 1.2, abs=1e-9)


@make_either
def test_walls_stop_drones(make: Callable[..., DroneGame]) -> None:
    game = make(1)
    corner = {True: np.array([1.5, 0.1]), False: np.array([1.5, 0.1, 0.0, 0.0])}[game.dynamics.drone_size == 2]
    states = fly(game, corner, np.tile([0.9, -0.7], (5, 1)))
    np.testing.assert_array_equal(states[-1, :2], [1.6, 0.0])
    assert ((states[:, :2] >= 0) & (states[:, :2] <= [1.6, 1.2])).all()


def test_a_drone_slides_along_a_wall() -> None:
    game = arena(1)
    after = game.step(np.array([[0.5, 0.0]]), np.array([[0.6, -0.8]]))
    np.testing.assert_allclose(after, [[0.5 + 0.25 * 0.6, 0.0]], rtol=0, atol=1e-15)


@make_either
def test_a_drone_at_its_goal_region_rests_there_for_ever_and_only_there(make: Callable[..., DroneGame]) -> None:
    game = make(2)
    states = np.zeros((1, 2, game.dynamics.drone_size))
    states[0, :, :2] = [[1.3, 0.81], [1.3, 0.99]]  # 0.19 m from the goal of the first, far from that of the second
    states[0, :, 2:] = 0.7
    after = game.drones(game.step(joint(states), np.array([[0.5, 0.5, -0.5, -0.5]])))
    np.testing.assert_array_equal(after[0, 0, :2], [1.3, 0.81])
    assert not after[0, 0, 2:].any()
    assert (after[0, 1, :2] != [1.3, 0.99]).any()


def test_the_rim_of_a_goal_region_belongs_to_it() -> None:
    game = arena(1, {"drones.0.goal_region": {"centre": (1.0, 1.0), "radius": 0.25}})
    states = np.array([[1.0, 0.75], [0.75, 1.0], [1.0, np.nextafter(0.75, 0)], [0.8, 0.8]])
    assert game.arrived(states)[:, 0].tolist() == [True, True, False, False]


def test_a_single_integrator_flies_by_the_rules_written_once_more() -> None:
    game, rng = arena(3), np.random.default_rng(1)
    slow = SlowArena(game.settings)
    states = joint(rng.uniform(0, game.arena, size=(400, 3, 2)))
    actions = RandomPilot(game, longest=1.5).act(0, states, rng)
    found = game.positions(game.step(states, actions))
    for before, controls, after in zip(game.positions(states), game.controls(actions), found, strict=True):
        expected = [slow.after(i, *pair) for i, pair in enumerate(zip(before, controls, strict=True))]
        np.testing.assert_allclose(after, expected, rtol=0, atol=1e-12)
    assert game.arrived(states).any(axis=0).all()


@make_either
def test_torch_flies_as_numpy_does(make: Callable[..., DroneGame]) -> None:
    torch = pytest.importorskip("torch")
    game = make(3, {"horizon": 8})
    rollouts = drone_rollouts(game, RandomPilot(game, longest=3), 50, np.random.default_rng(0))
    drones, controls = game.drones(rollouts.states), game.controls(rollouts.actions)
    other = game.dynamics.on("cpu", torch.float64)
    found = other.step(torch.from_numpy(drones), torch.from_numpy(controls))
    np.testing.assert_allclose(found.numpy(), game.dynamics.step(drones, controls), rtol=0, atol=1e-14)
    np.testing.assert_array_equal(
        other.arrived(torch.from_numpy(drones[..., :2])).numpy(), game.arrived(rollouts.states)
    )


@make_either
def test_drones_do_not_disturb_each_other(make: Callable[..., DroneGame]) -> None:
    both, alone = make(2), make(1)
    rollouts = random_rollouts(both, 20)
    d = alone.dynamics.drone_size
    after = both.step(rollouts.states[:, 0], rollouts.actions[:, 0])
    own = alone.step(rollouts.states[:, 0, :d], rollouts.actions[:, 0, :2])
    np.testing.assert_array_equal(after[:, :d], own)


@make_either
def test_starts_are_uniform_in_their_squares_and_at_rest(make: Callable[..., DroneGame]) -> None:
    game = make(3)
    drones = game.drones(game.starts(4000, np.random.default_rng(2)))
    assert not drones[..., 2:].any()
    for i, task in enumerate(game.settings.drones):
        inside = (drones[:, i, :2] - task.start) / max(task.start_spread, 1e-9)
        assert np.abs(inside).max() <= 1
        if task.start_spread:  # the moments of the uniform distribution on [-1, 1]; standard errors 0.009, 0.005
            np.testing.assert_allclose(inside.mean(axis=0), 0, atol=0.04)
            np.testing.assert_allclose((inside**2).mean(axis=0), 1 / 3, atol=0.025)
            assert abs(np.corrcoef(inside.T)[0, 1]) < 0.07


def test_a_square_that_reaches_beyond_the_wall_is_cut_there() -> None:
    """No drone begins outside, and none exactly at the wall, where all that lies beyond would otherwise gather."""
    game = arena(1, {"drones.0.start": (0.1, 0.1), "drones.0.start_spread": 0.3})
    starts = game.starts(2000, np.random.default_rng(3))
    assert starts.min() > 0
    np.testing.assert_allclose(starts.mean(axis=0), 0.2, atol=0.015)  # uniform from 0 to 0.4: standard error 0.003
    assert starts.max() <= 0.4


def test_the_same_generator_gives_the_same_starts() -> None:
    game = arena(2)
    one, same, other = (game.starts(5, np.random.default_rng(seed)) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert (one != other).all()


@make_either
def test_rollouts_follow_the_dynamics_step_by_step(make: Callable[..., DroneGame]) -> None:
    game = make(2)
    rollouts = random_rollouts(game, 5)
    assert rollouts.states.shape == (5, 4, game.state_size)
    assert rollouts.actions.shape == (5, 4, 4)
    for t in range(game.horizon):
        np.testing.assert_array_equal(
            game.step(rollouts.states[:, t], rollouts.actions[:, t]), rollouts.states[:, t + 1]
        )


def test_rollouts_from_given_starts_begin_there_equally_often() -> None:
    game = arena(1)
    starts = np.array([[0.1, 0.1], [0.2, 0.2], [0.2, 0.2], [0.4, 0.4]])
    rollouts = drone_rollouts(game, RandomPilot(game), 4000, np.random.default_rng(0), starts)
    shares = [float((rollouts.states[:, 0, 0] == x).mean()) for x in (0.1, 0.2, 0.4)]
    np.testing.assert_allclose(shares, [0.25, 0.5, 0.25], atol=0.03)


@make_either
@pytest.mark.parametrize("drones", [1, 2, 3])
def test_rollouts_come_back_bit_for_bit(make: Callable[..., DroneGame], drones: int) -> None:
    game = make(drones)
    for seed in range(20):
        rollout = random_rollouts(game, 1, seed)
        decoded = game.decode(*game.encode(rollout))
        for found, expected in zip(decoded, rollout, strict=True):
            assert found.tobytes() == expected.tobytes()
            assert found.shape == expected.shape


def impossible(game: DroneGame, change: Callable[[Array, Array], None]) -> str:
    """What is said of a rollout of ``game`` with a change made to its states and actions."""
    states, actions = game.encode(random_rollouts(game, 1))
    change(states, actions)
    with pytest.raises(ImpossibleTrajectoryError) as caught:
        game.decode(states, actions)
    return str(caught.value)


def put(which: int, step: int, column: int, *values: float) -> Callable[[Array, Array], None]:
    """Set numbers of the states (0) or of the actions (1)."""

    def change(*arrays: Array) -> None:
        arrays[which][step, column : column + len(values)] = values

    return change


SINGLE = [
    (put(0, 2, 1, np.nan), "states: expected finite numbers"),
    (put(0, 2, 1, np.inf), "states: expected finite numbers"),
    (put(1, 0, 3, -np.inf), "actions: expected finite numbers"),
    (put(0, 1, 2, 1.7, 0.5), "step 1: drone 2 is at (1.7, 0.5), outside the arena (1.6, 1.2) [m]"),
    (put(0, 3, 0, 0.5, -0.1), "step 3: drone 1 is at (0.5, -0.1), outside the arena (1.6, 1.2) [m]"),
    (put(0, 0, 0, 1e308, 1e308), "step 0: drone 1 is at (1e+308, 1e+308), outside the arena"),
    (put(1, 1, 2, 0.8, -1.0), "step 1: action (0.8, -1.0) of drone 2 is longer than 1.2 m/s"),
    (put(1, 3, 0, 1.7e308, 1.7e308), "step 3: action (1.7e+308, 1.7e+308) of drone 1 is longer than 1.2 m/s"),
    (put(0, 3, 2, 0.5, 0.5), "is then at (0.5, 0.5); the game allows only ("),
]


@pytest.mark.parametrize(("change", "message"), SINGLE)
def test_impossible_rollouts_are_refused_by_step_drone_and_value(change: Any, message: str) -> None:
    assert message in impossible(arena(2), change)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put(1, 2, 2, 2.0, 2.0), "step 2: action (2.0, 2.0) of drone 2 is longer than 2.5 m/s^2"),
        (put(0, 0, 6, 0.0, -1.3), "step 0: velocity (0.0, -1.3) of drone 2 is longer than 1.2 m/s"),
        (put(0, 0, 2, 1e308, 1.7e308), "step 0: velocity (1e+308, 1.7e+308) of drone 1 is longer than 1.2 m/s"),
        (put(0, 2, 2, 1.1, 0.1), "step 1: drone 1 with action"),
    ],
)
def test_impossible_rollouts_of_double_integrators_are_refused(change: Any, message: str) -> None:
    assert message in impossible(double(2), change)


def test_a_step_that_the_dynamics_do_not_allow_is_refused_with_the_one_that_they_do() -> None:
    game = arena(1, {"horizon": 2})
    actions = np.array([[0.4, 0.0], [0.0, 0.8], [0.0, 0.0]])
    states = fly(game, np.array([0.2, 0.2]), actions[:2])
    states[2] += [0.0, 0.01]
    with pytest.raises(ImpossibleTrajectoryError) as caught:
        game.decode(states, actions)
    assert str(caught.value) == (
        "step 1: drone 1 with action (0.0, 0.8) is then at (0.3, 0.41); the game allows only (0.3, 0.4)"
    )


def test_leaving_a_goal_region_is_impossible() -> None:
    game = arena(1, {"horizon": 1})
    with pytest.raises(ImpossibleTrajectoryError, match="the game allows only"):
        game.decode(np.array([[1.3, 1.0], [1.2, 1.0]]), np.array([[-0.4, 0.0], [0.0, 0.0]]))


def test_what_is_within_the_tolerance_is_accepted_as_it_is() -> None:
    game = arena(2)
    states, actions = game.encode(random_rollouts(game, 1))
    states[1:] += 1e-7
    decoded = game.decode(states, actions)
    np.testing.assert_array_equal(decoded.states[0], states)


@pytest.mark.parametrize(
    ("states", "actions", "message"),
    [
        ((3, 4), (4, 4), "states: shape (3, 4), expected (4, 4)"),
        ((4, 6), (4, 4), "states: shape (4, 6), expected (4, 4)"),
        ((4, 4), (4, 2), "actions: shape (4, 2), expected (4, 4)"),
        ((4, 4), (5, 4), "actions: shape (5, 4), expected (4, 4)"),
        ((16,), (4, 4), "states: shape (16,), expected (4, 4)"),
        ((0, 0), (0, 0), "states: shape (0, 0), expected (4, 4)"),
    ],
)
def test_wrong_shapes_are_refused(states: tuple[int, ...], actions: tuple[int, ...], message: str) -> None:
    with pytest.raises(ImpossibleTrajectoryError) as caught:
        arena(2).decode(np.zeros(states), np.zeros(actions))
    assert str(caught.value) == message
