"""The conformance suite on everything that is registered here, and on what breaks its rules."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
from arenas import drone_experiment
from experiments import experiment
from games import alone, doors, hallway

from mabirds_core import conformance
from mabirds_core.arrays import Array, Vector
from mabirds_core.consensus.push_sum_mixer import ResilientMixing
from mabirds_core.consensus.strict import StrictMixer, StrictMixing
from mabirds_core.costs.models import costs_of
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, build_method, build_reward
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories, Visitation
from mabirds_core.games.patrol import decoding
from mabirds_core.games.patrol.features import PatrolCostFeatures
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.games.patrol.whole_game import WholePatrolGame
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner
from mabirds_core.registry import METHODS, build, kind_of, kinds
from mabirds_core.rewards.models import LinearReward

QUICK_NETWORKS = {
    "hidden": 8,
    "steps": 3,
    "first_steps": 3,
    "batch": 8,
    "capacity": 200,
    "rollouts": 2,
}
PLANNERS: dict[str, dict[str, Any]] = {
    "soft_value_iteration": {},
    "soft_q_learning": {"episodes": 5, "sweeps": 1},
    "lattice": {"spacing": 0.3},
    "soft_actor_critic": QUICK_NETWORKS,
}


def patrol_experiment(changes: dict[str, Any] | None = None) -> Experiment:
    """The tiny experiment on a map that leaves experts a way."""
    return experiment({"game.map": "...\n...", **(changes or {})})


FORMS = {"tabular": patrol_experiment, "drones": drone_experiment}


@pytest.mark.parametrize("make", [patrol_experiment, drone_experiment], ids=["patrol", "drones"])
def test_games_conform(make: Any) -> None:
    conformance.check_game(build_game(make()))


def test_every_planner_of_this_repository_is_checked() -> None:
    own = {
        name for name, kind in kinds("mabirds.planners").items() if kind.settings.__module__.startswith("mabirds_core")
    }
    assert own == set(PLANNERS)


@pytest.mark.parametrize("name", PLANNERS)
def test_planners_conform(name: str) -> None:
    kind = kinds("mabirds.planners")[name]
    settings = conformance.check_settings(kind, {"kind": name, **PLANNERS[name]})
    of = FORMS[str(kind.form)]()
    game = build_game(of)
    reward = build_reward(of, game)
    conformance.check_planner(kind.build(settings, game, reward), game, reward)


@pytest.mark.parametrize("reward", [{"kind": "linear"}, {"kind": "neural", "hidden": 4, "bound": 2.0}], ids=str)
@pytest.mark.parametrize("make", [patrol_experiment, drone_experiment], ids=["patrol", "drones"])
def test_rewards_conform(make: Any, reward: dict[str, Any]) -> None:
    of = make({"algorithm.reward": reward})
    game = build_game(of)
    conformance.check_settings(kind_of("mabirds.rewards", of.algorithm.reward), reward)
    conformance.check_reward(build_reward(of, game), game)


BESIDE = {"kind": "network", "width": 3, "beside_features": True}


@pytest.mark.parametrize("cost", [{"kind": "linear"}, {"kind": "network", "width": 3, "bound": 2.0}, BESIDE], ids=str)
def test_costs_conform(cost: dict[str, Any]) -> None:
    of = patrol_experiment({"algorithm.cost": cost})
    game = build_game(of)
    conformance.check_settings(kind_of("mabirds.costs", of.algorithm.cost), cost)
    conformance.check_costs(costs_of(game), game)


@pytest.mark.parametrize("name", [name for name in kinds(METHODS) if name != "untouched"])
def test_methods_conform(name: str) -> None:
    of = patrol_experiment()
    game = build_game(of)
    conformance.check_method(build_method(of, name, game), game)


@pytest.mark.parametrize("mixing", [StrictMixing(), ResilientMixing(kind="resilient")], ids=["strict", "resilient"])
def test_mixers_conform(mixing: Any) -> None:
    schedule = conformance.complete_schedule(("ann", "bob", "cid"))
    conformance.check_mixers(build("mabirds.mixers", mixing, name, schedule) for name in schedule.learners)


@dataclass(frozen=True)
class Wrong(LinearReward):
    """Whose gradient is twice what it should be."""

    def gradient(self, theta: Vector, visitation: Visitation) -> Vector:
        return 2 * super().gradient(theta, visitation)


def test_a_wrong_gradient_is_noticed() -> None:
    game: Any = alone()
    with pytest.raises(AssertionError, match="gradient: expected that of the reward's table"):
        conformance.check_reward(Wrong(game.reward_features), game)


def test_a_game_that_checks_no_transitions_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoding, "_check_transitions", lambda *_: None)
    with pytest.raises(AssertionError, match="one step of which leads elsewhere; expected ImpossibleTrajectoryError"):
        conformance.check_game(WholePatrolGame(alone().settings))


@pytest.mark.parametrize("options", [{}, {"slip": 0.2}, {"truth": "unknown", "map": "...\n..."}], ids=str)
def test_the_options_of_patrols_make_whole_games(options: dict[str, Any]) -> None:
    settings = doors(6).settings.model_dump() | options
    conformance.check_game(WholePatrolGame(PatrolSettings.model_validate(settings)))


@dataclass(frozen=True)
class Signed:
    """Features that say that they are never negative, and are."""

    features: PatrolCostFeatures
    nonnegative = True

    @property
    def names(self) -> tuple[str, ...]:
        return self.features.names

    def total(self, visitation: Visitation) -> Vector:
        return -self.features.total(visitation)

    def table(self, weights: Vector) -> Array:
        return -self.features.table(weights)


def test_features_that_are_negative_and_say_that_they_are_not_are_noticed() -> None:
    game: Any = alone()
    conformance.check_game(game)
    game.cost_features = Signed(game.cost_features)
    with pytest.raises(AssertionError, match="expected none below 0 of features that say nonnegative = True"):
        conformance.check_game(game)


class Fickle(SoftBellmanPlanner):
    """Which finds another policy each time."""

    def plan(self, theta: Vector, omega: Vector, *_: Any, **__: Any) -> Any:
        return super().plan(theta + np.random.default_rng().normal(size=theta.shape), omega)


def test_a_planner_that_finds_another_policy_each_time_is_noticed() -> None:
    game: Any = hallway()
    reward = LinearReward(game.reward_features)
    with pytest.raises(AssertionError, match="expected the same policy from the same arguments"):
        conformance.check_planner(Fickle(game, reward, game.cost_features), game, reward)


@dataclass(frozen=True)
class Stubborn(StrictMixer):
    """Which listens to nobody."""

    def mix(self, state: Any, iteration: int, local_step: Any) -> Any:
        return state._replace(received=None)


def test_a_mixer_that_listens_to_nobody_is_noticed() -> None:
    schedule = conformance.complete_schedule(("ann", "bob"))
    with pytest.raises(AssertionError, match="ann: expected the mean of all learners' parameters"):
        conformance.check_mixers(Stubborn(name, schedule) for name in schedule.learners)


def test_a_method_that_forgets_to_count_is_noticed() -> None:
    of = patrol_experiment()
    game = build_game(of)
    method: Any = build_method(of, "bics", game)

    class Forgetful:
        def initial_state(self) -> Any:
            return method.initial_state()

        def update(self, state: Any, demonstrations: Trajectories) -> Any:
            return method.update(state, demonstrations)._replace(iteration=1)

    with pytest.raises(AssertionError, match="update: iteration 1, expected 2"):
        conformance.check_method(Forgetful(), game)


def test_a_kind_that_is_not_installed_is_refused_with_what_there_is() -> None:
    with pytest.raises(ExperimentError, match="'magic' is none of the methods .*install the package that brings it"):
        build_method(experiment(), "magic")
    assert replace(kinds(METHODS)["ftl"]).form is None


class Boundless(WholePatrolGame):
    """Measures nothing that is a number."""

    def measures(self, omega: Vector, demonstrations: Trajectories) -> dict[str, dict[str, float]]:
        return {"cost": {"door": float("inf")}}


def test_a_measure_that_is_not_finite_is_noticed() -> None:
    with pytest.raises(AssertionError, match="measures: cost is not finite"):
        conformance.check_game(Boundless(patrol_experiment().game))
