"""Tiny drone games, pilots that fly at random, experiments with them, and the rules once more for single drones."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from experiments import changed

from mabirds_core.arrays import Array
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.rewards import TrueDroneReward
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.whole_game import WholeDroneGame
from mabirds_core.games.interface import Trajectories

Pair = tuple[float, float]

ARENA: dict[str, Any] = {
    "kind": "drones",
    "arena": (1.6, 1.2),
    "obstacles": [{"centre": (0.8, 0.6), "radius": 0.15}],
    "drones": [
        {"start": (0.3, 0.3), "start_spread": 0.1, "goal_region": {"centre": (1.3, 1.0), "radius": 0.2}},
        {"start": (1.3, 0.2), "start_spread": 0.1, "goal_region": {"centre": (0.2, 0.9), "radius": 0.25}},
        {"start": (0.8, 1.0), "start_spread": 0.0, "goal_region": {"centre": (0.8, 0.1), "radius": 0.1}},
    ],
    "time_step": 0.25,
    "horizon": 3,
    "discount": 0.9,
    "max_speed": 1.2,
    "max_acceleration": 2.5,
    "drone_radius": 0.1,
    "least_distance": 0.3,
    "step_cost": 0.5,
    "features": {
        "cost_spacing": 0.4,
        "cost_width": 0.25,
        "distance_levels": (0.2, 0.5),
        "distance_softness": 0.05,
        "distance_scale": 2.0,
        "effort_scale": 0.3,
        "reward_spacing": 0.8,
        "reward_width": 0.5,
    },
}
"""Three drones; games of fewer take the first ones."""


def arena_settings(drones: int = 2, changes: dict[str, Any] | None = None) -> DroneSettings:
    """``ARENA`` with its first drones and some settings replaced, named by dotted path."""
    return DroneSettings.model_validate(changed(changes or {}, {**ARENA, "drones": ARENA["drones"][:drones]}))


def arena(drones: int = 2, changes: dict[str, Any] | None = None) -> DroneGame:
    """The game of it."""
    return DroneGame(arena_settings(drones, changes))


def double(drones: int = 2, changes: dict[str, Any] | None = None) -> DroneGame:
    """The same with double integrators."""
    return arena(drones, {"dynamics": "double_integrator", **(changes or {})})


@dataclass(frozen=True)
class RandomPilot:
    """Actions of up to ``longest`` times the largest length, uniform in direction and length."""

    game: DroneGame
    longest: float = 1.0

    def act(self, step: int, states: Array, rng: np.random.Generator) -> Array:
        """An action of each drone for M joint states, shape (M, 2 N_E)."""
        angles, shares = rng.random((2, len(states), self.game.n_experts))
        lengths = self.longest * self.game.dynamics.max_action * shares
        turned = np.stack([np.cos(2 * np.pi * angles), np.sin(2 * np.pi * angles)], axis=-1)
        return np.asarray((lengths[..., None] * turned).reshape(len(states), -1))


def random_rollouts(game: DroneGame, count: int, seed: int = 0) -> Trajectories:
    """Of random pilots from P_0."""
    return drone_rollouts(game, RandomPilot(game), count, np.random.default_rng(seed))


def joint(values: Array) -> Array:
    """What is given by drone, (..., N_E, D), as joint states or actions."""
    return values.reshape(*values.shape[:-2], -1)


class SlowArena:
    """The rules for one drone once more, with numbers instead of arrays."""

    def __init__(self, settings: DroneSettings) -> None:
        self.settings = settings

    def after(self, drone: int, place: Pair, velocity: Pair) -> Pair:
        """Where a single integrator is one step later."""
        s, goal = self.settings, self.settings.drones[drone].goal_region
        if math.dist(place, goal.centre) <= goal.radius:
            return place
        share = min(1.0, s.max_speed / math.hypot(*velocity)) if any(velocity) else 1.0
        x, y = (
            min(max(p + s.time_step * share * v, 0.0), side)
            for p, v, side in zip(place, velocity, s.arena, strict=True)
        )
        return x, y

    def fade(self, drone: int, place: Pair) -> float:
        """What is left of cost bumps near the drone's goal."""
        goal = self.settings.drones[drone].goal_region
        return 1 - math.exp(-(math.dist(place, goal.centre) ** 2) / (2 * goal.radius**2))

    def nodes(self, spacing: float) -> list[Pair]:
        """Centres of RBFs: columns from left to right, each from below."""
        xs, ys = (
            [side * k / n for k in range(n + 1)]
            for side, n in ((side, math.ceil(side / spacing - 1e-9)) for side in self.settings.arena)
        )
        return [(x, y) for x in xs for y in ys]

    def place_costs(self, drone: int, place: Pair) -> list[float]:
        """Cost RBFs of one drone."""
        f, fade = self.settings.features, self.fade(drone, place)
        return [rbf(math.dist(place, node), f.cost_width) * fade for node in self.nodes(f.cost_spacing)]

    def distance_costs(self, distance: float) -> list[float]:
        """Cost steps of one pair."""
        f = self.settings.features
        beyond = [(distance - level) / f.distance_softness for level in f.distance_levels]
        return [f.distance_scale / (1 + math.exp(above)) for above in beyond]

    def effort(self, action: Pair, longest: float) -> float:
        """Cost of one drone's action."""
        return self.settings.features.effort_scale * (math.hypot(*action) / longest) ** 2

    def place_rewards(self, place: Pair) -> list[float]:
        """Reward RBFs of one drone."""
        f = self.settings.features
        return [rbf(math.dist(place, node), f.reward_width) for node in self.nodes(f.reward_spacing)]


def rbf(distance: float, width: float) -> float:
    """exp(-d^2 / 2 width^2)."""
    return math.exp(-(distance**2) / (2 * width**2))


DRONE_EXPERIMENT: dict[str, Any] = {
    "name": "drones",
    "game": {**ARENA, "drones": ARENA["drones"][:2], "horizon": 6},
    "algorithm": {
        "steps": {"alpha": 2.0, "beta": 1.0},
        "rollouts": 6,
        "window": 3,
        "expectation": "sampled",
        "policy": {"kind": "lattice", "spacing": 0.173, "temperature": 1.0},
    },
    "learners": ["ann", "bob"],
    "schedule": {"kind": "static"},
    "demonstrations": {"bag": "bag", "per_learner": 5, "experts": "pilots"},
    "iterations": 5,
    "seed": 3,
    "constraint_threshold": 0.1,
}
"""An experiment with two drones."""


def drone_settings(changes: dict[str, Any] | None = None) -> dict[str, Any]:
    """``DRONE_EXPERIMENT`` with some settings replaced, named by dotted path."""
    return changed(changes or {}, DRONE_EXPERIMENT)


def drone_experiment(changes: dict[str, Any] | None = None) -> Experiment:
    """The experiment of it."""
    return Experiment.model_validate(drone_settings(changes))


def drone_game(of: Experiment) -> WholeDroneGame:
    """The experiment's game, which is one of drones."""
    game = build_game(of)
    assert isinstance(game, WholeDroneGame)
    return game


def drone_streams(of: Experiment, seed: int = 0) -> dict[str, list[Trajectories]]:
    """A stream per learner, of drones that hurry to their goal regions."""
    game, rng = drone_game(of), np.random.default_rng(seed)
    planner = LatticePlanner(game, TrueDroneReward(game), spacing=0.173, temperature=0.1)
    policy = planner.plan(np.zeros(0), np.zeros(len(game.cost_features.names)))
    return {name: [drone_rollouts(game, policy, 1, rng) for _ in range(of.iterations)] for name in of.learners}
