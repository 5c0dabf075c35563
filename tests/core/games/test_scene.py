"""Games from above: places, costs and ways are those of the game's own features."""

from pathlib import Path

import numpy as np
import pytest

from mabirds_core.arrays import Vector
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.names import parameter_names
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_core.games.scene import Raster, Scene, scene_of
from mabirds_core.games.whole_game import Game

CONFIG = Path(__file__).resolve().parents[3] / "ros_ws" / "config"


def game_of(name: str) -> tuple[Game, Scene]:
    game = build_game(load_experiment(CONFIG / f"{name}.yaml"))
    scene = scene_of(game)
    assert scene is not None
    return game, scene


def shown(game: Game) -> Trajectories:
    (trajectory,) = game.experts(game.expert_kinds[0], "by_start").demonstrations(1, np.random.default_rng(2))
    return trajectory


def cells_at(raster: Raster, places: Vector) -> tuple[Vector, Vector]:
    columns, rows = (np.floor(places[..., k] / raster.resolution).astype(int) for k in (0, 1))
    return np.minimum(rows, raster.rows - 1), np.minimum(columns, raster.columns - 1)


def test_a_patrols_way_costs_on_the_map_what_its_features_say() -> None:
    game, scene = game_of("patrol")
    omega = np.random.default_rng(0).normal(size=len(game.cost_features.names))
    omega[-2:] = 0.0  # sharing and swapping are no places
    trajectory = shown(game)
    rows, columns = cells_at(scene.raster, scene.positions(trajectory)[0])
    costs = scene.costs(omega)[np.arange(game.n_experts), rows, columns].sum()
    assert costs == pytest.approx(-omega @ game.cost_features.total(discounted_visitation(trajectory, 1.0)))


def test_experts_of_a_patrol_end_at_their_goals_and_pass_no_forbidden_cell() -> None:
    game, scene = game_of("patrol")
    places = scene.positions(shown(game))
    assert places.shape == (1, game.horizon + 1, game.n_experts, 2)
    assert np.array_equal(places[0, -1], scene.goals)
    rows, columns = cells_at(scene.raster, places)
    assert not scene.forbidden[rows, columns].any()
    assert scene.forbidden.sum() == game.true_constraints[: len(scene.spots()) // game.n_experts].sum()


def test_a_spot_is_where_its_feature_costs() -> None:
    game, scene = game_of("patrol")
    names, spots = game.cost_features.names, scene.spots()
    for name in ("expert_1 in (0, 0)", "expert_2 in (3, 5)", "expert_1 in (6, 2)"):
        omega = -1.0 * np.array([each == name for each in names])
        expert, x, y = spots[name]
        assert scene.costs(omega)[expert, int(y), int(x)] == 1.0 == scene.costs(omega).sum()
    assert "sharing a cell" not in spots


def test_drones_costs_are_those_of_a_drone_at_rest() -> None:
    game, scene = game_of("drones")
    omega = np.random.default_rng(0).normal(size=len(game.cost_features.names))
    costs, features = scene.costs(omega), game.cost_features
    assert costs.shape == (game.n_experts, scene.raster.rows, scene.raster.columns)
    row, column = 7, 21
    state = np.zeros((1, scene.positions(shown(game)).shape[-1] * 2))
    state[0, :2] = (column + 0.5) * 0.1, (row + 0.5) * 0.1
    for drone in range(game.n_experts):
        at_rest = -features.unary(omega, drone, state, np.zeros((1, 2)))  # type: ignore[attr-defined]
        assert costs[drone, row, column] == pytest.approx(float(at_rest[0]))


def test_drones_that_demonstrate_touch_nothing_forbidden() -> None:
    game, scene = game_of("drones")
    rows, columns = cells_at(scene.raster, scene.positions(shown(game)))
    assert scene.forbidden[rows, columns].mean() < 0.02  # cells are 10 cm wide
    assert 0 < scene.forbidden.mean() < 0.5
    near = [name for name, spot in scene.spots().items() if f"({spot.x:.2f}, {spot.y:.2f}) m" in name]
    assert len(near) == len(scene.spots()) > 100


def test_every_parameter_of_the_shipped_patrol_has_a_name() -> None:
    experiment = load_experiment(CONFIG / "patrol.yaml")
    game = build_game(experiment)
    names = parameter_names(experiment, "learner_1", game)
    assert names.omega == game.cost_features.names
    assert len(set(names.theta)) == len(names.theta) == 4 * 49 * 2 + 2 + 100  # moves, being late, what was shown
    assert parameter_names(experiment, "me_greedy", game).theta == ()
