"""Places that were recorded, followed by drones."""

import numpy as np
import pytest
from pydantic import ValidationError

from mabirds_core.errors import ExperimentError, ImpossibleTrajectoryError
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.whole_game import WholeDroneGame
from mabirds_core.games.interface import Trajectories
from mabirds_core.registry import build

SETTINGS = {
    "kind": "drones",
    "arena": (4.0, 2.0),
    "drones": [
        {"start": (0.5, 1.0), "start_spread": (0.3, 0.8), "goal_region": {"centre": (3.5, 1.0), "radius": 0.3}},
        {"start": (0.5, 1.0), "start_spread": 0.3, "goal_region": {"centre": (3.5, 0.4), "radius": 0.3}},
    ],
    "time_step": 0.5,
    "horizon": 8,
    "max_speed": 1.0,
    "truth": "unknown",
}


def game(**changes: object) -> WholeDroneGame:
    return WholeDroneGame(DroneSettings.model_validate({**SETTINGS, **changes}))


def test_what_the_game_could_have_flown_is_followed_exactly() -> None:
    of, rng = game(), np.random.default_rng(0)
    states = of.starts(1, rng)
    actions = rng.uniform(-0.7, 0.7, (9, 1, 4))
    flown = [states]
    for action in actions:
        flown.append(of.step(flown[-1], action))
    fit = of.fit_places(of.positions(np.concatenate(flown)))
    np.testing.assert_allclose(fit.trajectory.states[0], np.concatenate(flown)[:-1], atol=1e-12)
    np.testing.assert_allclose(fit.places, of.positions(fit.trajectory.states[0]))
    again = of.decode(*of.encode(fit.trajectory))
    np.testing.assert_array_equal(again.states, fit.trajectory.states)


def test_drones_that_are_too_slow_lag_behind_and_those_that_have_arrived_stay() -> None:
    of = game()
    places = np.zeros((10, 2, 2))
    places[:, 0] = np.linspace((0.5, 1.0), (3.5 + 1.5, 1.0), 10)  # on through its goal region
    places[:, 1] = (3.0, 1.9)
    places[0, 1] = (0.5, 1.0)  # and a jump of 2.7 m
    fit = of.fit_places(places)
    assert fit.arrived[:, 0].tolist() == [False] * 6 + [True] * 3
    assert np.ptp(fit.places[6:, 0], axis=0).max() == 0
    steps = np.hypot(*np.diff(fit.places[:, 1], axis=0).T)
    np.testing.assert_allclose(steps[:5], 0.5)
    np.testing.assert_allclose(fit.places[6:, 1], [[3.0, 1.9]] * 3)
    assert isinstance(of.decode(*of.encode(fit.trajectory)), Trajectories)


def test_places_outside_the_arena_end_at_its_walls() -> None:
    places = np.full((10, 2, 2), 5.0)
    assert game().fit_places(places).places.max(axis=(0, 1)).tolist() == [4.0, 2.0]


def test_other_shapes_and_other_dynamics_are_refused() -> None:
    with pytest.raises(ExperimentError, match=r"expected \(10, 2, 2\)"):
        game().fit_places(np.zeros((9, 2, 2)))
    with pytest.raises(ExperimentError, match="single_integrator"):
        game(dynamics="double_integrator").fit_places(np.zeros((10, 2, 2)))


def test_starts_fill_a_rectangle_and_may_overlap_where_nobody_knows_the_truth() -> None:
    places = game().positions(game().starts(4000, np.random.default_rng(0)))
    np.testing.assert_allclose(places[:, 0].min(axis=0), [0.2, 0.2], atol=0.01)
    np.testing.assert_allclose(places[:, 0].max(axis=0), [0.8, 1.8], atol=0.01)
    with pytest.raises(ValueError, match="may start closer"):
        game(truth="settings")
    assert build("mabirds.games", DroneSettings.model_validate(SETTINGS)).digest == game().digest


def test_where_nobody_knows_the_truth_nothing_is_said_that_needs_it() -> None:
    of = game()
    assert of.true_constraints is None
    assert of.judge.imitation(None, 0) is None
    halves = zip(SETTINGS["drones"], (0.5, 1.5), strict=True)
    apart = [{**drone, "start": (0.5, y), "start_spread": 0.1} for drone, y in halves]
    known = game(truth="settings", drones=apart)
    assert known.true_constraints is not None


def flown_with_noise(of: WholeDroneGame, noise: float) -> tuple[Trajectories, np.ndarray, np.ndarray]:
    """A flight, and its states and actions as they were observed: up to ``noise`` off, each drone at each step."""
    rng = np.random.default_rng(7)
    flown, actions = [of.starts(1, rng)], rng.uniform(-0.6, 0.6, (9, 1, 4))
    for action in actions:
        flown.append(of.step(flown[-1], action))
    states = np.concatenate(flown[:-1])
    angles = rng.uniform(0, 2 * np.pi, (9, 2))
    off = noise * np.stack([np.cos(angles), np.sin(angles)], axis=-1).reshape(9, 4)
    exact = Trajectories(states[None], actions[:, 0][None])
    return exact, np.clip(states + off, 0, np.tile(of.arena, 2)), actions[:, 0]


def test_flights_that_were_observed_with_noise_are_flights_near_by() -> None:
    of = game(observation_noise=0.05)
    exact, states, actions = flown_with_noise(of, 0.04)
    seen = of.decode(states, actions)
    away = np.linalg.norm(of.positions(seen.states) - of.positions(states), axis=-1)
    assert np.abs(seen.states - exact.states).max() > 0
    assert away.max() <= 0.05
    np.testing.assert_array_equal(of.step(seen.states[0, :-1], seen.actions[0, :-1]), seen.states[0, 1:])
    again = of.decode(*of.encode(seen))  # as in messages and checkpoints
    np.testing.assert_array_equal(again.states, seen.states)
    np.testing.assert_array_equal(again.actions, seen.actions)


def test_exact_flights_stay_as_they_are() -> None:
    of = game(observation_noise=0.05)
    exact, _, actions = flown_with_noise(of, 0.0)
    np.testing.assert_array_equal(of.decode(exact.states[0], actions).states, exact.states)


def test_more_noise_than_the_settings_have_is_refused_with_the_step() -> None:
    of = game(observation_noise=0.05)
    _, states, actions = flown_with_noise(of, 0.0)
    states[4, 2] += 1.5
    with pytest.raises(ImpossibleTrajectoryError, match=r"step 4: drone 2 was observed .* where it can be, .* 0.05 m"):
        of.decode(states, actions)
    with pytest.raises(ImpossibleTrajectoryError, match="step"):
        game().decode(*flown_with_noise(game(), 0.01)[1:])


def test_noise_of_accelerating_drones_is_refused() -> None:
    with pytest.raises(ValidationError, match="observation_noise 0.1: expected 0 with dynamics double_integrator"):
        game(observation_noise=0.1, dynamics="double_integrator")
