"""What is to be beaten on held-out flights: probabilities by brute force, noises that are found again, distances."""

from typing import Any

import numpy as np
import pytest

from mabirds_core.games.drones.forecasts import AimedForecast, VelocityForecast, forecasts, from_starts
from mabirds_core.games.drones.planner_settings import LatticeSettings
from mabirds_core.games.drones.rewards import TrueDroneReward
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.whole_game import WholeDroneGame
from mabirds_core.games.interface import Trajectories

SETTINGS = {
    "kind": "drones",
    "arena": (4.0, 2.0),
    "drones": [
        {"start": (0.5, 1.4), "start_spread": 0.3, "goal_region": {"centre": (3.6, 1.4), "radius": 0.35}},
        {"start": (3.5, 0.6), "start_spread": 0.3, "goal_region": {"centre": (0.4, 0.6), "radius": 0.35}},
    ],
    "time_step": 0.5,
    "horizon": 12,
    "max_speed": 1.0,
    "truth": "unknown",
}
LATTICE = LatticeSettings(kind="lattice")


@pytest.fixture(scope="module")
def game() -> WholeDroneGame:
    return WholeDroneGame(DroneSettings.model_validate(SETTINGS))


@pytest.fixture(scope="module")
def policy(game: WholeDroneGame) -> Any:
    planner = game.evaluation_planner(LATTICE, TrueDroneReward(game))  # type: ignore[arg-type]
    return planner.plan(np.empty(0), np.zeros(len(game.cost_features.names)))


@pytest.fixture(scope="module")
def flights(game: WholeDroneGame, policy: Any) -> Trajectories:
    starts = Trajectories(game.starts(40, np.random.default_rng(0))[:, None], np.empty((40, 1, 4)))
    return from_starts(game, policy, starts, 1, np.random.default_rng(1))


@pytest.mark.parametrize("name", ["counting", "constant velocity", "straight to the goal"])
def test_probabilities_of_all_moves_sum_to_one(
    game: WholeDroneGame, policy: Any, flights: Trajectories, name: str
) -> None:
    """log pi/mu as it is told, against a sum over all nodes written out."""
    forecast = forecasts(policy, flights)[name]
    drone, places = forecast.drones[0], game.positions(flights.states)[:, 3, 0]
    aims, moves = places + np.array([0.2, 0.1]), drone.moves_from(places)
    total = np.zeros(len(places))
    for column in range(moves.nodes.shape[1]):
        there = moves.nodes[:, column] >= 0
        chosen = np.where(there, moves.nodes[:, column], moves.nodes[:, 0])
        told = forecast._told(drone, places, aims, chosen, np.array([0.7]))[0]
        total += np.where(there & (moves.shares[:, column] > 0), moves.shares[:, column] * np.exp(told), 0.0)
    np.testing.assert_allclose(total, 1.0)
    sigma, k = 0.7 * game.dynamics.reach, int(np.flatnonzero(~drone.arrived(places))[0])
    weights = moves.shares[k] * np.exp(-((drone.places[moves.nodes[k]] - aims[k]) ** 2).sum(axis=1) / (2 * sigma**2))
    expected = np.log(weights[2] / weights.sum() / moves.shares[k, 2])
    assert forecast._told(drone, places, aims, moves.nodes[:, 2], np.array([0.7]))[0, k] == pytest.approx(expected)


@pytest.mark.parametrize("sigma", [0.2, 0.5])
def test_the_noise_of_flights_is_found_again(
    game: WholeDroneGame, policy: Any, flights: Trajectories, sigma: float
) -> None:
    straight = forecasts(policy, flights)["straight to the goal"]
    straight.__dict__["noise"] = sigma
    flown = straight.rollouts(flights, 10, np.random.default_rng(2))
    found = AimedForecast(game, straight.drones, straight.aims, flown).noise
    assert found == pytest.approx(sigma, rel=0.12)
    of_itself = straight.log_ratios(flown).mean()
    others = [forecasts(policy, flights)[name].log_ratios(flown).mean() for name in ("counting", "constant velocity")]
    assert of_itself > max(*others, 0.0)


def test_constant_velocity_deviates_as_much_as_the_training(game: WholeDroneGame, policy: Any) -> None:
    rng, count = np.random.default_rng(3), 400
    states = np.repeat(game.starts(1, rng)[None], count, axis=0).repeat(13, axis=1)
    first = rng.uniform(-0.1, 0.1, (count, 4))
    later = first + 0.2 * rng.standard_normal((count, 4))
    states[:, 1:] += 0.5 * first[:, None]
    states[:, 2:] += 0.5 * np.arange(1, 12)[None, :, None] * later[:, None] * 0.3
    actions = np.repeat(first[:, None], 13, axis=1)
    forecast = VelocityForecast(
        game, [of.nodes for of in policy.drones], lambda *_: None, Trajectories(states, actions)
    )  # type: ignore[arg-type]
    mean = (states[:, -1] - states[:, 0]) / 12 / 0.5
    assert forecast.deviation == pytest.approx(float(np.sqrt(np.mean((mean - first) ** 2))))


def test_distances_are_told_until_the_drone_shown_has_arrived(game: WholeDroneGame) -> None:
    shown = np.zeros((1, 13, 4))
    shown[..., :2] = np.linspace((0.5, 1.4), (6.5, 1.4), 13)[None].clip(0, 3.5)  # arrives at step 6
    shown[..., 2:] = (2.0, 0.6)  # never arrives
    flown = np.repeat(shown, 2, axis=0)
    flown[1, :, :2] += (0.0, 0.3)
    flown[1, 9:, :2] += 5.0  # after it has arrived: not counted
    judge = game.held_out_judge
    actions = np.zeros((1, 13, 4))
    average, final = judge.displacements(Trajectories(shown, actions), Trajectories(flown, np.zeros((2, 13, 4))), 2)
    np.testing.assert_allclose(average, [[0.0, 6 * 0.3 / (6 + 12)]])
    np.testing.assert_allclose(final, [[0.0, 0.15]])
    assert judge.steps(Trajectories(shown, actions)).tolist() == [13]
    assert judge.conflicts(Trajectories(shown, actions)) == {"too close": 0.0}
