"""Goal regions that are doors: all places near a segment."""

from typing import Any

import numpy as np
import pytest

from mabirds_core.errors import ExperimentError
from mabirds_core.games.drones.planner_checks import check_soft_actor_critic
from mabirds_core.games.drones.planner_settings import LatticeSettings, SoftActorCriticSettings
from mabirds_core.games.drones.regions import GoalRegion
from mabirds_core.games.drones.rewards import TrueDroneReward
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.whole_game import WholeDroneGame

DISC: dict[str, Any] = {"centre": (3.6, 1.0), "radius": 0.35}
DOOR: dict[str, Any] = {"centre": (3.6, 0.4), "until": (3.6, 1.6), "radius": 0.35}


def game(region: dict[str, Any]) -> WholeDroneGame:
    settings = {
        "kind": "drones",
        "arena": (4.0, 2.0),
        "drones": [{"start": (0.5, 1.0), "start_spread": 0.3, "goal_region": region}],
        "time_step": 0.5,
        "horizon": 12,
        "step_cost": 8.0,
    }
    return WholeDroneGame(DroneSettings.model_validate(settings))


def test_a_door_is_what_is_near_any_of_its_points() -> None:
    places = np.random.default_rng(0).uniform((2.8, 0.0), (4.0, 2.0), (3000, 2))
    points = np.linspace(DOOR["centre"], DOOR["until"], 2001)
    away = ((places[:, None] - points) ** 2).sum(axis=-1).min(axis=1)
    np.testing.assert_allclose(GoalRegion(**DOOR).away(places), away, atol=1e-3)
    clear = np.abs(np.sqrt(away) - 0.35) > 1e-3
    arrived = game(DOOR).arrived(places)[:, 0]
    np.testing.assert_array_equal(arrived[clear], (away <= 0.35**2)[clear])
    assert 0.2 < arrived.mean() < 0.8


def test_a_disc_is_a_door_of_no_length() -> None:
    """The digest names no door, so that bags of before fit."""
    places = np.random.default_rng(0).uniform((2.8, 0.0), (4.0, 2.0), (500, 2))
    short = {**DISC, "until": (3.6, 1.0 + 1e-9)}
    np.testing.assert_array_equal(game(DISC).arrived(places), game(short).arrived(places))
    assert game(DISC).digest != game(DOOR).digest
    assert game(DISC).dynamics.goal_ways is None


def test_drones_leave_by_all_of_a_door() -> None:
    of = game(DOOR)
    planner = of.evaluation_planner(LatticeSettings(kind="lattice"), TrueDroneReward(of))  # type: ignore[arg-type]
    policy = planner.plan(np.empty(0), np.zeros(len(of.cost_features.names)))
    ends = of.positions(of.judge.rollouts(policy, seed=0).states)[:, -1, 0]  # type: ignore[arg-type]
    there = of.arrived(ends)[:, 0]
    assert there.mean() > 0.95
    assert np.ptp(ends[there, 1]) > 1.0


def test_doors_that_are_none_and_planners_without_doors_are_refused() -> None:
    with pytest.raises(ValueError, match="another place than centre"):
        game({**DISC, "until": DISC["centre"]})
    with pytest.raises(ValueError, match=r"expected a place in the arena"):
        game({**DISC, "until": (3.6, 2.6)})
    with pytest.raises(ExperimentError, match="goal regions must be discs"):
        check_soft_actor_critic(SoftActorCriticSettings(kind="soft_actor_critic"), game(DOOR))
