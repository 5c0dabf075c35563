"""What a game offers that recordings of places can be imported to; games need not."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Protocol

import numpy as np

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.interface import Trajectories


class Goal(NamedTuple):
    """Where an expert wants to be: a disc, or a door, which is all that is near a segment.

    Attributes
    ----------
    centre : tuple[float, float]
        x, y [m].
    radius : float
        [m]
    until : tuple[float, float] or None
        The other end of a door [m].
    """

    centre: tuple[float, float]
    radius: float
    until: tuple[float, float] | None

    def distances(self, places: Array) -> Vector:
        """Of places (M, 2) to its centre, or to the segment of a door, shape (M,) [m]."""
        way = np.subtract(self.until or self.centre, self.centre)
        along = ((places - self.centre) @ way) / max(float(way @ way), 1e-12)
        return np.asarray(np.hypot(*(places - self.centre - np.clip(along, 0.0, 1.0)[:, None] * way).T))


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

    @property
    def residual_limit(self) -> float:
        """How far samples may be from a trajectory, where rules do not say [m]."""
        ...

    def fit_places(self, places: Array) -> Fit:
        """The trajectory that follows places recorded at the steps 0 .. T + 1, shape (T + 2, N_E, 2) [m]."""
        ...


class Forecast(Protocol):
    """Who says what experts will do."""

    def log_ratios(self, demonstrations: Trajectories) -> Vector:
        """Nats by which demonstrations are likelier than under the uniform policy, shape (m,)."""
        ...

    def rollouts(self, demonstrations: Trajectories, count: int, rng: np.random.Generator) -> Trajectories:
        """Trajectories from where demonstrations began.

        Parameters
        ----------
        demonstrations : Trajectories
            m of them; nothing but their starts is looked at, or what the forecaster says that it is told.
        count : int
            k: from each start.
        rng : np.random.Generator
            Of the draw.

        Returns
        -------
        Trajectories
            m k of them, those of the first start first.
        """
        ...


class HeldOutJudge(Protocol):
    """How a game compares forecasts with demonstrations that nobody learned from."""

    def of_policy(self, policy: Any) -> Forecast:
        """A learned policy as a forecast."""
        ...

    def baselines(self, policy: Any, planner: Any, training: Trajectories) -> Mapping[str, Forecast]:
        """What is to be beaten.

        Parameters
        ----------
        policy : Any
            A learned one.
        planner : Any
            Settings of its planner.
        training : Trajectories
            From which their numbers are taken.

        Returns
        -------
        Mapping[str, Forecast]
            By name.
        """
        ...

    def steps(self, demonstrations: Trajectories) -> Vector:
        """Over how many steps each demonstration is told, shape (m,)."""
        ...

    def displacements(self, demonstrations: Trajectories, flown: Trajectories, count: int) -> tuple[Array, Array]:
        """Average and final distances.

        Parameters
        ----------
        demonstrations : Trajectories
            m of them.
        flown : Trajectories
            ``count`` from each start.
        count : int
            k.

        Returns
        -------
        tuple[Array, Array]
            Shape (m, k) each [m].
        """
        ...

    def conflicts(self, trajectories: Trajectories) -> Mapping[str, float]:
        """Shares of trajectories by what must not be, as far as the settings say so."""
        ...
