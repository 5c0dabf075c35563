"""What two drones cost each other at any two places: C_t of ``coupling``, linear in the triangles between nodes."""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector
from mabirds_core.games.drones.lattice import LatticePolicy
from mabirds_core.games.drones.lone_fields import Float

LEAST_WEIGHT = 1e-3
"""Where the nodes around two places have less, no drone can be there, and C is 0."""


class Surroundings(NamedTuple):
    """Nodes around K places of a drone in each of M joint states.

    Attributes
    ----------
    nodes : Indices
        All of them, shape (M, W).
    corners : Indices
        Which of these make the triangle around a place, shape (M, K, 3).
    weights : Float
        Of the corners at the place, shape (M, K, 3); a node that the drone cannot have reached has none.
    """

    nodes: Indices
    corners: Indices
    weights: Float


@dataclass(frozen=True)
class PairCoupling:
    """C_t at any places, in units of tau.

    Attributes
    ----------
    lattice : LatticePolicy
        Of these two drones on a lattice.
    """

    lattice: LatticePolicy

    def at_start(self, states: Array) -> Vector:
        """C_0 of joint states (M, 4) by first moves to nodes, shape (M,)."""
        places, result = self.lattice.game.positions(states), self.lattice.values(0, states)
        for i in range(2):
            result -= self.lattice.lone_values(i, places[:, i])
        return result

    def values(self, step: int, first: Array, second: Array) -> Float:
        """C_t of every two places.

        Parameters
        ----------
        step : int
            t, from 1 to T.
        first : Array
            Of the first drone, shape (M, K, 2) [m].
        second : Array
            Of the second one, shape (M, L, 2) [m].

        Returns
        -------
        Float
            In nats, shape (M, K, L).
        """
        around, other = self._around(0, step, first), self._around(1, step, second)
        meetings = self.lattice.tables[step - 1].values(around.nodes[:, :, None], other.nodes[:, None, :])
        halfway = _interpolated(meetings.astype(np.float32), around).swapaxes(1, 2)
        total = np.ascontiguousarray(_interpolated(halfway, other).swapaxes(1, 2))
        known = around.weights.sum(axis=2)[:, :, None] * other.weights.sum(axis=2)[:, None, :]
        return np.asarray(total / np.maximum(known, LEAST_WEIGHT))

    def _around(self, drone: int, step: int, places: Array) -> Surroundings:
        """Of places (M, K, 2): k is below, plus x and y, along b_1 and b_2."""
        basis, origin = self._frame
        k = places @ np.linalg.inv(basis) - origin
        below = np.floor(k)
        x, y = np.moveaxis(k - below, -1, 0)
        upper = x + y > 1
        low, high = np.stack([1 - x - y, x, y], axis=-1), np.stack([x + y - 1, 1 - y, 1 - x], axis=-1)
        weights = np.where(upper[..., None], high, low).astype(np.float32)
        least = below.min(axis=1).astype(np.int64)
        i, j = np.moveaxis(below.astype(np.int64) - least[:, None], -1, 0)
        width = 2 + int(max(i.max(), j.max()))
        corners = np.stack([(i + upper) * width + j + upper, (i + 1) * width + j, i * width + j + 1], axis=-1)
        nodes = self._window(drone, least, width)
        reached = nodes < self.lattice.drones[drone].nodes.reached[step - 1]
        weights *= np.take_along_axis(reached[:, None], corners, axis=2)
        return Surroundings(np.where(reached, nodes, 0), corners, weights)

    def _window(self, drone: int, least: Indices, width: int) -> Indices:
        """Nodes with k from ``least`` (M, 2) on, ``width`` along both, shape (M, W)."""
        numbers, ahead = self._numbers[drone], np.arange(width)
        rows, columns = (np.clip(least[:, i, None] + ahead, 0, numbers.shape[i] - 1) for i in (0, 1))
        return np.asarray(numbers[rows[:, :, None], columns[:, None, :]].reshape(len(least), -1))

    @cached_property
    def _numbers(self) -> list[Indices]:
        """Of every drone, by k less the least one, the number of the node or of the nearest one."""
        basis, origin = self._frame
        result = list[Indices]()
        for of in (drone.nodes for drone in self.lattice.drones):
            k = np.stack(np.meshgrid(*map(np.arange, of.coordinates.max(axis=0) + 2), indexing="ij"), axis=-1)
            places = np.clip((k + origin) @ basis, 0.0, self.lattice.game.settings.arena)
            result.append(of.nearest(places.reshape(-1, 2)).reshape(places.shape[:2]))
        return result

    @cached_property
    def _frame(self) -> tuple[Array, Array]:
        """b_1 and b_2 as rows, and o: nodes are at (k + o) b, with k counted from the least one."""
        lattice = self.lattice.drones[0].nodes.lattice
        k = lattice.places @ np.linalg.inv(lattice.basis)
        return lattice.basis, np.median(k - lattice.coordinates, axis=0)


def _interpolated(values: Float, around: Surroundings) -> Float:
    """Rows of values (M, W, ...) of nodes, at the places that these are around, shape (M, K, ...)."""
    rows, values = np.arange(len(values))[:, None], np.ascontiguousarray(values)
    parts = (around.weights[:, :, i, None] * values[rows, around.corners[:, :, i]] for i in range(3))
    return np.asarray(sum(parts, np.zeros(1, np.float32)))
