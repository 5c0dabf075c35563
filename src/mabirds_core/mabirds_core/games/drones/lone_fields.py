"""What a drone without the others is worth at any place, by quadrature over the disc of its actions.

    V_t(s) = log int mu(da) exp( r(s, a) + gamma V_{t+1}(s') ),     V_{T+1} = 0,     mu uniform in the disc

in units of tau. Unlike those of ``lattice``, these are values of the game with continuous actions: a lattice gives to
moves of full length what mu says of the whole cell around them, and its V_0 is nats too high. They are kept on a grid
over the arena and interpolated by cubics; in goal regions, where drones stay for ever, V_t = (1 + gamma + ..) r(s, 0).

Where lateness is dear, values jump by hundreds of nats at the places from which a drone may just arrive in time. Cubics
overshoot there, which would draw drones to the brink; so they are held within the values that they pass through.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy.sparse import block_diag, csr_array

from mabirds_core.arrays import Array, Indices, Mask, Vector
from mabirds_core.games.drones.drone_nodes import Rewards
from mabirds_core.games.drones.game import DroneGame

Float = NDArray[np.float32]

RADII, ANGLES = 6, 18
"""Points of the quadrature, by Gauss along the squared radius: exact to .01 nats where Q differs by 20 nats across."""

TAPS = np.arange(-1, 3)
"""Points of the grid that a cubic passes through, from the one below."""

STEEP = 15.0
"""Cubics are held within the values at their 4 x 4 points where these differ by more [nats]."""


@dataclass(frozen=True)
class FieldGrid:
    """A grid over the arena, and what actions do from its points for drone i; it knows of no reward."""

    game: DroneGame
    drone: int

    @cached_property
    def axes(self) -> list[Vector]:
        """x and y of its points [m]."""
        spacing = self.game.dynamics.reach / 2
        return [np.linspace(0, side, max(4, round(side / spacing) + 1)) for side in self.game.settings.arena]

    @cached_property
    def places(self) -> Array:
        """Of its points, shape (X, Y, 2)."""
        return np.stack(np.meshgrid(*self.axes, indexing="ij"), axis=-1)

    @cached_property
    def quadrature(self) -> tuple[Array, Vector]:
        """Actions (Q, 2) and their shares of mu (Q,)."""
        squares, shares = np.polynomial.legendre.leggauss(RADII)
        radii, angles = np.sqrt((squares + 1) / 2), 2 * np.pi * (np.arange(ANGLES) + 0.5) / ANGLES
        directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
        actions = self.game.dynamics.max_action * (radii[:, None, None] * directions).reshape(-1, 2)
        return actions, np.repeat(shares / 2 / ANGLES, ANGLES)

    @cached_property
    def after(self) -> Array:
        """Where actions lead from every point, shape (Q, X, Y, 2)."""
        ways = self.game.dynamics.time_step * self.quadrature[0]
        return np.clip(self.places + ways[:, None, None], 0.0, self.game.settings.arena)

    @cached_property
    def home(self) -> Mask:
        """Which of these places are in the goal region, shape (Q, X, Y)."""
        return self.arrived(self.after)

    @cached_property
    def shifts(self) -> tuple[csr_array, csr_array]:
        """Interpolation where actions lead: along x, (Q X, X), and along y, (Q Y, Q Y), one action after the other.

        Sparse, so that sums have one order; BLAS splits those of full matrices by the threads that it has.
        """
        x = taps(self.axes[0], self.after[:, :, 0, 0].ravel())
        y = taps(self.axes[1], self.after[:, 0, :, 1].ravel()).reshape(len(self.after), len(self.axes[1]), -1)
        return csr_array(x.astype(np.float32)), csr_array(block_diag(y.astype(np.float32)))

    @cached_property
    def around(self) -> Indices:
        """Which 4 x 4 points are around where actions lead: a number for each, row by row, shape (Q, X, Y)."""
        x, y = (first_tap(self.axes[i], at) for i, at in ((0, self.after[:, :, 0, 0]), (1, self.after[:, 0, :, 1])))
        return np.asarray(x[:, :, None] * (len(self.axes[1]) - 3) + y[:, None])

    def shifted(self, values: Float) -> Float:
        """What values (X, Y) are where actions lead, shape (Q, X, Y)."""
        along_x, along_y = self.shifts
        actions, (wide, deep) = len(self.after), values.shape
        ahead = (along_x @ values).reshape(actions, wide, deep).transpose(0, 2, 1)
        ahead = along_y @ ahead.reshape(actions * deep, wide)
        return self._held(values, ahead.reshape(actions, deep, wide).transpose(0, 2, 1))

    def _held(self, values: Float, ahead: Float) -> Float:
        """``ahead`` within the values around it where these jump."""
        around = sliding_window_view(values, (4, 4))
        low, high = around.min(axis=(2, 3)), around.max(axis=(2, 3))
        steep = high - low > STEEP
        if not steep.any():
            return ahead
        low, high = np.where(steep, low, -np.inf).ravel(), np.where(steep, high, np.inf).ravel()
        return np.clip(ahead, low[self.around], high[self.around])

    def arrived(self, places: Array) -> Mask:
        """Which places (..., 2) are in the drone's goal region, shape (...)."""
        goal = self.game.settings.drones[self.drone].goal_region
        return np.asarray(goal.away(places) <= goal.radius**2)


@dataclass(frozen=True)
class LoneField:
    """V of one drone.

    Attributes
    ----------
    grid : FieldGrid
        Where values are kept.
    idle : Float
        r(s, 0) / tau of a drone under way, shape (X, Y): smooth across the edge of its goal region.
    effort : float
        (r(s, a) - r(s, 0)) / tau |a|^2, the same everywhere.
    arriving : float
        What a step earns besides where it ends in the goal region, in nats.
    under_way : float
        What r(s, 0) has besides where the drone is under way, in nats.
    values : Float
        V_t of places outside the goal region, shape (T + 2, X, Y).
    """

    grid: FieldGrid
    idle: Float
    effort: float
    arriving: float
    under_way: float
    values: Float

    @classmethod
    def of(cls, grid: FieldGrid, rewards: Rewards, temperature: float) -> "LoneField":
        """Soft value iteration.

        Parameters
        ----------
        grid : FieldGrid
            Where values are kept.
        rewards : Rewards
            What r is the sum of: each of the place, by its square of the action, and of arriving.
        temperature : float
            tau.

        Returns
        -------
        LoneField
            With its values.
        """
        game, home = grid.game, grid.home

        def reward(places: Array, action: Array | Sequence[float] = (0.0, 0.0)) -> Array:
            terms = (of.unary(weights, grid.drone, places, np.array(action)) for of, weights in rewards)
            return np.asarray(sum(terms, np.zeros(places.shape[:-1]))) / temperature

        actions, shares = grid.quadrature
        goal, most = np.array(game.settings.drones[grid.drone].goal_region.centre), game.dynamics.max_action
        effort = float(reward(goal, (most, 0.0)) - reward(goal)) / most**2
        arriving = sum(of.arriving(w, grid.drone) for of, w in rewards if hasattr(of, "arriving")) / temperature
        scores = (np.log(shares) + effort * (actions**2).sum(axis=1)).astype(np.float32)[:, None, None]
        under_way = arriving * (1 / game.discount - 1)  # lateness is the difference of a potential
        idle = (reward(grid.places) + under_way * grid.arrived(grid.places)).astype(np.float32)
        arrived = reward(grid.after[home]).astype(np.float32)
        values, left = np.zeros((game.horizon + 2, *idle.shape), np.float32), steps_left(game)
        for step in range(game.horizon, -1, -1):
            ahead = grid.shifted(values[step + 1])
            ahead[home] = left[step + 1] * arrived + arriving / game.discount
            values[step] = idle + _log_sum_exp(np.float32(game.discount) * ahead + scores)
        return cls(grid, idle, effort, arriving, under_way, values)

    def at(self, step: int, places: Array) -> Array:
        """V_t.

        Parameters
        ----------
        step : int
            t.
        places : Array
            Shape (..., 2) [m].

        Returns
        -------
        Array
            In nats, shape (...).
        """
        grid = self.grid
        first = [first_tap(axis, places[..., i]) for i, axis in enumerate(grid.axes)]
        x, y = (cubic(places[..., i] / axis[1] - first[i] - 1) for i, axis in enumerate(grid.axes))
        free = sliding_window_view(self.values[step], (4, 4))[*first]
        stays = sliding_window_view(self.idle, (4, 4))[*first]
        home = grid.arrived(places)
        around = np.where(home[..., None, None], steps_left(grid.game)[step] * (stays - self.under_way), free)
        value = sum(sum(around[..., i, j] * y[j] for j in range(4)) * x[i] for i in range(4))
        low, high = around.min(axis=(-2, -1)), around.max(axis=(-2, -1))
        return np.asarray(np.where(high - low > STEEP, np.clip(value, low, high), value))


def steps_left(game: DroneGame) -> Vector:
    """h_t = 1 + gamma h_{t+1}, what a reward of one in every step left is worth, shape (T + 2,)."""
    return np.append((game.discount ** np.arange(game.horizon + 1)).cumsum()[::-1], 0.0)


def first_tap(axis: Vector, at: Array) -> Indices:
    """The first of the four points that a cubic passes through.

    Parameters
    ----------
    axis : Vector
        Evenly spaced points, shape (X,), four at least.
    at : Array
        Where, of any shape.

    Returns
    -------
    Indices
        From 0 to X - 4, of the same shape.
    """
    return np.asarray(np.clip(np.floor(at / axis[1]).astype(np.int64), 1, len(axis) - 3) - 1)


def taps(axis: Vector, at: Vector) -> Array:
    """Interpolate by cubics.

    Parameters
    ----------
    axis : Vector
        Evenly spaced points, shape (X,), four at least.
    at : Vector
        Where, shape (M,).

    Returns
    -------
    Array
        A row of X weights for each, shape (M, X).
    """
    below, rows = first_tap(axis, at) + 1, np.arange(len(at))
    result = np.zeros((len(at), len(axis)))
    result[rows[:, None], below[:, None] + TAPS] = np.stack(cubic(at / axis[1] - below), axis=-1)
    return result


def cubic(way: Any) -> list[Any]:
    """Weights of the points at -1, 0, 1 and 2 for the cubic through them, at ``way``."""
    return [
        -way * (way - 1) * (way - 2) / 6,
        (way + 1) * (way - 1) * (way - 2) / 2,
        -(way + 1) * way * (way - 2) / 2,
        (way + 1) * way * (way - 1) / 6,
    ]


def _log_sum_exp(scores: Float) -> Float:
    """Over the first axis."""
    most = scores.max(axis=0)
    scores -= most
    return np.asarray(most + np.log(np.exp(scores, out=scores).sum(axis=0)), dtype=np.float32)
