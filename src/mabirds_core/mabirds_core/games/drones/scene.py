"""The drones' arena from above."""

from collections.abc import Mapping
from functools import cached_property
from typing import Any

import numpy as np

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.learned_costs import place_costs
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.scene import Raster, Spot

RESOLUTION = 0.1
"""Metres between two places whose costs are drawn."""


class DroneScene:
    """``games.scene.Scene`` of drones.

    Parameters
    ----------
    game : DroneGame
        With the arena.
    """

    def __init__(self, game: DroneGame) -> None:
        self._game = game
        width, depth = (int(np.ceil(side / RESOLUTION - 1e-9)) for side in game.settings.arena)
        self.raster = Raster(depth, width, RESOLUTION)

    @property
    def goals(self) -> Array:
        """Middles of the goal regions."""
        return np.array([task.goal_region.centre for task in self._game.settings.drones])

    @property
    def starts(self) -> Array:
        """Middles of the starts' squares."""
        return np.array([task.start for task in self._game.settings.drones])

    @cached_property
    def forbidden(self) -> Mask:
        """Where a drone's middle would touch an obstacle."""
        return self._game.settings.touched(self.raster.centres)

    def costs(self, omega: Vector) -> Array:
        """Learned costs of places, without effort."""
        drones = range(self._game.n_experts)
        return np.stack([place_costs(self._game, omega, drone, self.raster.centres) for drone in drones])

    def positions(self, trajectories: Trajectories) -> Array:
        """Where the drones are."""
        return np.asarray(self._game.positions(trajectories.states))

    def spots(self) -> Mapping[str, Spot]:
        """Nodes of the features of places."""
        features = self._game.cost_features
        names = iter(features.names)
        drones = range(self._game.n_experts)
        return {next(names): Spot(drone, float(x), float(y)) for drone in drones for x, y in features.grid.nodes}

    def rollouts(self, policy: Any, count: int, rng: np.random.Generator) -> Trajectories:
        """Fly by the policy."""
        return drone_rollouts(self._game, policy, count, rng)
