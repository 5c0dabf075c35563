"""What a game looks like from above, in metres: what maps, markers and paths of it are drawn from.

A game that has such a look has a property ``scene``; games without places have none, and nothing of them is drawn.
"""

from collections.abc import Mapping
from typing import NamedTuple, Protocol

import numpy as np

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories


class Raster(NamedTuple):
    """Square cells that cover the plane of a game; row 0 is at the bottom (least y), column 0 at the left.

    Attributes
    ----------
    rows : int
        Along y.
    columns : int
        Along x.
    resolution : float
        Side of a cell [m].
    """

    rows: int
    columns: int
    resolution: float

    @property
    def centres(self) -> Array:
        """x and y of every cell's centre, shape (rows, columns, 2) [m]."""
        x, y = ((np.arange(count) + 0.5) * self.resolution for count in (self.columns, self.rows))
        return np.stack(np.meshgrid(x, y), axis=-1)


class Spot(NamedTuple):
    """Where a cost feature lies that is a place of one expert.

    Attributes
    ----------
    expert : int
        Index.
    x : float
        In metres.
    y : float
        In metres.
    """

    expert: int
    x: float
    y: float


class Scene(Protocol):
    """A game from above; its lower left corner is the origin."""

    @property
    def raster(self) -> Raster:
        """In which costs are drawn."""
        ...

    @property
    def goals(self) -> Array:
        """Where experts are going, shape (N_E, 2) [m]."""
        ...

    @property
    def starts(self) -> Array:
        """Where experts begin, on average over P_0, shape (N_E, 2) [m]."""
        ...

    @property
    def forbidden(self) -> Mask:
        """Which cells no expert may really enter, shape (rows, columns); for people and metrics only."""
        ...

    def costs(self, omega: Vector) -> Array:
        """Learned cost of being in a cell.

        Parameters
        ----------
        omega : Vector
            Cost weights, shape (K,).

        Returns
        -------
        Array
            Shape (N_E, rows, columns), in units of reward.
        """
        ...

    def positions(self, trajectories: Trajectories) -> Array:
        """Where experts are.

        Parameters
        ----------
        trajectories : Trajectories
            m of them.

        Returns
        -------
        Array
            Shape (m, T + 1, N_E, 2) [m].
        """
        ...

    def spots(self) -> Mapping[str, Spot]:
        """Cost features that are places, by name; others, such as distances, are left out."""
        ...

    def rollouts(self, policy: object, count: int, rng: np.random.Generator) -> Trajectories:
        """Follow a policy.

        Parameters
        ----------
        policy : object
            Of the game.
        count : int
            m.
        rng : numpy.random.Generator
            Of starts and actions.

        Returns
        -------
        Trajectories
            m of them.
        """
        ...


def scene_of(game: ConstrainedMarkovGame) -> Scene | None:
    """The look of a game; None where it has none."""
    scene: Scene | None = getattr(game, "scene", None)
    return scene
