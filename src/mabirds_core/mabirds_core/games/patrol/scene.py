"""Patrols from above: a cell is a square metre, row 0 of the map is at the top."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.scene import Raster, Spot
from mabirds_core.planners.occupancy import rollouts


class PatrolScene:
    """``games.scene.Scene`` of patrols.

    Parameters
    ----------
    game : PatrolGame
        With the map.
    """

    def __init__(self, game: PatrolGame) -> None:
        self._game = game
        self.raster = Raster(game.height, game.width, 1.0)

    def _places(self, cells: Indices) -> Array:
        """Middles of cells: x to the right, y up."""
        rows, columns = np.divmod(cells, self._game.width)
        return np.stack([columns + 0.5, self._game.height - rows - 0.5], axis=-1)

    @property
    def goals(self) -> Array:
        """Middles of each expert's goal cells."""
        return np.stack([self._places(np.flatnonzero(own)).mean(axis=0) for own in self._game.grid.is_goal])

    @property
    def starts(self) -> Array:
        """Means of the start cells, by their probabilities."""
        game = self._game
        places = self._places(game.cells(np.arange(game.n_states)))
        return np.asarray(np.einsum("s,esx->ex", game.initial_distribution, places))

    @property
    def forbidden(self) -> Mask:
        """Obstacles."""
        return np.asarray(self._game.obstacles.reshape(self.raster.rows, self.raster.columns)[::-1])

    def costs(self, omega: Vector) -> Array:
        """-omega of each expert's cells; of a network, what they cost more than the cheapest."""
        game = self._game
        by_feature = costs_of(game).by_feature(omega)
        by_cell = by_feature[: game.n_experts * game.n_cells].reshape(game.n_experts, game.height, game.width)
        return 0.0 - by_cell[:, ::-1]

    def positions(self, trajectories: Trajectories) -> Array:
        """Middles of the cells that experts are in."""
        return np.moveaxis(self._places(self._game.cells(trajectories.states)), 0, 2)

    def spots(self) -> Mapping[str, Spot]:
        """The cells of each expert."""
        game = self._game
        places = self._places(np.arange(game.n_cells))
        names = iter(game.cost_features.names)
        return {next(names): Spot(expert, float(x), float(y)) for expert in range(game.n_experts) for x, y in places}

    def rollouts(self, policy: Any, count: int, rng: np.random.Generator) -> Trajectories:
        """Draw from the policy."""
        return rollouts(self._game, policy, count, rng)
