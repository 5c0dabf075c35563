"""What a game offers that recordings of places can be imported to; games need not."""

from collections.abc import Sequence
from typing import NamedTuple, Protocol

from mabirds_core.arrays import Array, Mask
from mabirds_core.games.interface import Trajectories


class Goal(NamedTuple):
    """Where an expert wants to be: a disc.

    Attributes
    ----------
    centre : tuple[float, float]
        x, y [m].
    radius : float
        [m]
    """

    centre: tuple[float, float]
    radius: float


class Observed(NamedTuple):
    """What recordings tell of a game; places are counted from the lower left corner of the area.

    Attributes
    ----------
    sides : tuple[float, float]
        Width and depth of the area [m].
    starts : Array
        Where episodes began, shape (n, N_E, 2) [m].
    goals : Sequence[Goal]
        Of each expert.
    time_step : float
        [s]
    horizon : int
        T.
    max_speed : float
        [m/s]
    """

    sides: tuple[float, float]
    starts: Array
    goals: Sequence[Goal]
    time_step: float
    horizon: int
    max_speed: float


class Fit(NamedTuple):
    """What a game makes of places that were recorded.

    Attributes
    ----------
    trajectory : Trajectories
        One, of the game.
    places : Array
        Where its experts are, shape (T + 1, N_E, 2) [m].
    arrived : Mask
        Which of them are where they wanted to be, shape (T + 1, N_E).
    """

    trajectory: Trajectories
    places: Array
    arrived: Mask


class FitsRecordings(Protocol):
    """A game that recordings of places can be imported to."""

    def fit_places(self, places: Array) -> Fit:
        """The trajectory that follows places recorded at the steps 0 .. T + 1, shape (T + 2, N_E, 2) [m]."""
        ...
