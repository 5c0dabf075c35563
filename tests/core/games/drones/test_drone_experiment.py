"""Experiment files of drones: the shipped one, what a game leaves to choose, lattices, messages."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from arenas import ARENA, arena, drone_experiment, drone_game, drone_settings
from experiments import SETTINGS, changed
from pydantic import create_model

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import load_experiment, planners_for
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.planner_checks import MAX_VALUES
from mabirds_core.games.drones.planner_settings import LatticeSettings
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.drones.settings import DroneSettings, DroneTask
from mabirds_core.games.drones.whole_game import build_lattice
from mabirds_core.games.patrol.settings import PatrolSettings

DRONES = Path(__file__).resolve().parents[4] / "ros_ws" / "config" / "drones.yaml"

CHOICES = {
    "patrol": {
        "algorithm.policy.kind": ["soft_q_learning", "soft_value_iteration"],
        "algorithm.expectation": ["exact", "sampled"],
        "demonstrations.experts": ["optimal", "soft"],
    },
    "drones": {
        "algorithm.policy.kind": ["lattice", "soft_actor_critic"],
        "algorithm.expectation": ["sampled"],
        "demonstrations.experts": ["pilots"],
    },
}
"""What each kind of game leaves to choose."""


def write(directory: Path, content: dict[str, Any]) -> Path:
    file = directory / "experiment.yaml"
    file.write_text(yaml.safe_dump(jsonable(content)), encoding="utf-8")
    return file


def jsonable(content: Any) -> Any:
    """Tuples as lists, which is what files have."""
    if isinstance(content, dict):
        return {name: jsonable(value) for name, value in content.items()}
    return [jsonable(value) for value in content] if isinstance(content, list | tuple) else content


def refusal(file: Path) -> str:
    with pytest.raises(ExperimentError) as caught:
        load_experiment(file)
    return str(caught.value).removeprefix(f"{file}: ")


def test_the_shipped_experiment_loads() -> None:
    loaded = load_experiment(DRONES)
    assert loaded.name == "drones"
    assert isinstance(loaded.game, DroneSettings)
    assert isinstance(loaded.algorithm.policy, LatticeSettings)
    game = DroneGame(loaded.game)
    assert (game.n_experts, game.state_size, game.action_size) == (2, 4, 4)
    assert 0 < game.true_constraints.sum() < len(game.true_constraints) / 4
    assert loaded.iterations <= loaded.demonstrations.per_learner


def test_a_written_experiment_is_read_back(tmp_path: Path) -> None:
    loaded = load_experiment(write(tmp_path, drone_settings()))
    expected = drone_experiment({"demonstrations.bag": str(tmp_path.resolve() / "bag")})
    assert loaded.model_dump() == expected.model_dump()
    assert loaded.digest == expected.digest


def test_files_without_a_kind_mean_patrols(tmp_path: Path) -> None:
    assert "kind" not in SETTINGS["game"]
    loaded = load_experiment(write(tmp_path, SETTINGS))
    assert isinstance(loaded.game, PatrolSettings)
    assert load_experiment(write(tmp_path, changed({"game.kind": "patrol"}))).digest == loaded.digest


CASES = [
    (drone_settings({"algorithm.policy": {"kind": "soft_q_learning"}}), "algorithm.policy.kind 'soft_q_learning'"),
    (drone_settings({"algorithm.policy": {"kind": "soft_value_iteration"}}), "algorithm.policy.kind 'soft_value_iter"),
    (drone_settings({"algorithm.expectation": "exact"}), "algorithm.expectation 'exact'"),
    (drone_settings({"demonstrations.experts": "optimal"}), "demonstrations.experts 'optimal'"),
    (drone_settings({"demonstrations.experts": "soft"}), "demonstrations.experts 'soft'"),
    (changed({"algorithm.policy": {"kind": "lattice"}}), "algorithm.policy.kind 'lattice'"),
    (changed({"algorithm.policy": {"kind": "soft_actor_critic"}}), "algorithm.policy.kind 'soft_actor_critic'"),
    (changed({"demonstrations.experts": "pilots"}), "demonstrations.experts 'pilots'"),
]


@pytest.mark.parametrize(("content", "opening"), CASES, ids=[opening for _, opening in CASES])
def test_what_is_not_made_for_the_game_is_refused_with_what_is(
    tmp_path: Path, content: dict[str, Any], opening: str
) -> None:
    kind = content["game"].get("kind", "patrol")
    name = opening.split(" ", maxsplit=1)[0]
    message = refusal(write(tmp_path, content))
    assert opening in message
    assert message.endswith(f": the game is {kind}; take one of {CHOICES[kind][name]}")


def test_an_option_that_drones_get_later_changes_no_digest() -> None:
    """Drones and their goal regions stand in a list of settings."""
    experiment = drone_experiment()
    later = create_model("LaterTask", __base__=DroneTask, weight=(float, 1.0))
    tasks = tuple(later.model_validate(task.model_dump()) for task in experiment.game.drones)
    game = experiment.game.model_copy(update={"drones": tasks})
    assert experiment.model_copy(update={"game": game}).digest == experiment.digest
    heavier = game.model_copy(update={"drones": (tasks[0].model_copy(update={"weight": 2.0}), *tasks[1:])})
    assert experiment.model_copy(update={"game": heavier}).digest != experiment.digest


@pytest.mark.parametrize("policy", ["soft_value_iteration", "soft_q_learning", "lattice", "soft_actor_critic"])
def test_every_policy_planner_is_made_for_one_of_the_games(policy: str) -> None:
    assert sum(policy in planners_for(form) for form in ("tabular", "drones")) == 1


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"game.drones": ARENA["drones"]}, "found 3 drones that are single_integrators"),
        ({"game.dynamics": "double_integrator"}, "found 2 drones that are double_integrators"),
    ],
    ids=["three", "double"],
)
def test_lattices_are_for_one_or_two_single_integrators(tmp_path: Path, changes: dict[str, Any], found: str) -> None:
    message = refusal(write(tmp_path, drone_settings(changes)))
    assert f"algorithm.policy lattice: made for one or two single integrators, {found}" in message
    assert message.endswith("take soft_actor_critic")
    other = {"kind": "soft_actor_critic"}
    assert load_experiment(write(tmp_path, drone_settings({**changes, "algorithm.policy": other})))


@pytest.mark.parametrize(("drones", "spacing", "horizon"), [(1, 0.002, 2_000), (2, 0.02, 40), (2, 0.045, 2_000)])
def test_lattices_must_fit_into_memory(tmp_path: Path, drones: int, spacing: float, horizon: int) -> None:
    changes = {"game.drones": ARENA["drones"][:drones], "game.horizon": horizon}
    values = (1.6 * 1.2 / (spacing**2 * math.sin(math.pi / 3))) ** drones * (horizon + 1)
    message = refusal(write(tmp_path, drone_settings({**changes, "algorithm.policy.spacing": spacing})))
    assert f"spacing {spacing:g} m makes {values:.2g} values, expected at most {MAX_VALUES:.2g}; take a la" in message
    assert load_experiment(write(tmp_path, drone_settings({**changes, "algorithm.policy.spacing": 1.5 * spacing})))


def test_what_is_checked_is_what_is_kept() -> None:
    settings = drone_experiment({"algorithm.policy.spacing": 0.05}).algorithm.policy
    game = arena(2, {"horizon": 30})
    model = LinearDroneReward(game)
    planner: Any = build_lattice(settings, game, model)
    policy = planner.plan(np.zeros(model.size), np.zeros(len(game.cost_features.names)))
    values = (1.6 * 1.2 / (0.05**2 * math.sin(math.pi / 3))) ** 2 * 31
    kept = sum(table.codes.size for table in policy.tables)
    assert 0.8 * values < kept < values


@pytest.mark.parametrize(
    ("spacing", "message"),
    [
        (0.31, "spacing 0.31 m: drones fly 0.3 m in a step, and would reach no other node; take a smaller one"),
        (0.25, "goal_region of drone 2 has radius 0.14 m, and may have no node; expected at least 0.144338 m for alg"),
    ],
)
def test_lattices_must_have_neighbours_and_goals(tmp_path: Path, spacing: float, message: str) -> None:
    changes = {"algorithm.policy.spacing": spacing, "game.drones.1.goal_region.radius": 0.14}
    assert message in refusal(write(tmp_path, drone_settings(changes)))


def test_the_default_lattice_has_thirteen_moves() -> None:
    game = drone_game(drone_experiment())
    planner: Any = build_lattice(LatticeSettings(kind="lattice"), game, LinearDroneReward(game))
    assert planner.lattices[0][0].moves.nodes.shape[1] == 13
    assert planner.spacing == pytest.approx(0.3 / 3**0.5)


@pytest.mark.parametrize("spacing", [0.0, -0.1, 1e-320])
def test_lattices_have_a_spacing(tmp_path: Path, spacing: float) -> None:
    message = refusal(write(tmp_path, drone_settings({"algorithm.policy.spacing": spacing})))
    assert message.startswith("algorithm.policy.lattice.spacing: Input should be greater than or equal to")


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"game.kind": "chess"}, "game: Input tag 'chess'"),
        ({"game.horizon": 0}, "game.horizon: Input should be greater than or equal to 1 (given: 0)"),
        (
            {"game.drones.1.goal_region.radius": -1},
            "game.drones.1.goal_region.radius: Input should be greater than or equal to",
        ),
        ({"game.drones.0.start": [0.5, 0.6]}, "game: start of drone 1 touches the obstacle at (0.8, 0.6)"),
        ({"game.features.wings": 2}, "game.features.wings: Extra inputs are not permitted (given: 2)"),
        ({"game.room": [1.6, 1.2]}, "game.room: now arena; rename it (given: [1.6, 1.2])"),
        ({"game.pillars": []}, "game.pillars: now obstacles; rename it (given: [])"),
        ({"game.drones.0.door": 1}, "game.drones.0.door: now goal_region; rename it (given: 1)"),
        ({"baselines": {"ftl": {"most_steps": 3}}}, "baselines.ftl.most_steps: now max_steps; rename it (given: 3)"),
        ({"game": 7}, "game: Input should be"),
        ({"game": {"kind": "drones", "arena": [1, 1]}}, "game.drones: Field required"),
        (
            {"algorithm.rollouts": 1_000_000, "game.horizon": 10_000},
            "algorithm.rollouts 1000000: expected at most 9999",
        ),
    ],
    ids=lambda value: str(value)[:40] if isinstance(value, dict) else "",
)
def test_wrong_settings_are_named_as_in_the_file(tmp_path: Path, changes: dict[str, Any], message: str) -> None:
    assert message in refusal(write(tmp_path, drone_settings(changes)))


def test_the_digest_is_of_the_game_too() -> None:
    digests = {
        drone_experiment(changes).digest
        for changes in (
            {},
            {"game.obstacles": []},
            {"algorithm.policy.spacing": 0.3},
            {"algorithm.policy.temperature": 2.0},
        )
    }
    assert len(digests) == 4
    assert drone_experiment({"demonstrations.side": "random"}).digest in digests


def test_planners_that_take_no_part_let_drones_fly_as_fast_as_they_can() -> None:
    """Their longest move is a step's way, and no learner draws their lattices."""
    game: Any = drone_game(drone_experiment())
    planners = game.judging_planners(LatticeSettings(kind="lattice", temperature=2.0), game.linear_reward())
    assert len(planners) == 3
    own = game.evaluation_planner(LatticeSettings(kind="lattice"), game.linear_reward())
    for planner in planners.values():
        assert (planner.temperature, planner.draws) == (2.0, False)
        assert planner.spacing < own.spacing
        cells = game.dynamics.reach / planner.spacing
        assert round(cells**2, 9) in {4, 5, 7}
