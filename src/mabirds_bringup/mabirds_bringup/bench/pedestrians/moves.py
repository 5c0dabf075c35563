"""The moves of a walker: by how much the way of a step differs from the way of the step before.

Constant velocity is the middle of a disc; around it lie cells between rings and rays, small where people's ways differ
by little, and large outside. The disc turns with the walker: angle 0 is straight ahead. A move is a cell, and mu says
what share of the disc's area it has: nats against mu do not depend on how finely the disc is cut.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector

RINGS = (0.03, 0.07, 0.12, 0.19, 0.28, 0.4, 0.6, 0.9, 1.5)
"""Outer radii, the first of the middle cell [m]; a longer deviation counts as one of the last ring."""

RAYS = 12


@dataclass(frozen=True)
class Moves:
    """Cell 0 is the middle, then come the cells of the first ring by angle, and so on."""

    rings: tuple[float, ...] = RINGS
    rays: int = RAYS

    @property
    def count(self) -> int:
        """A."""
        return 1 + (len(self.rings) - 1) * self.rays

    @cached_property
    def ring(self) -> Indices:
        """Of each cell, 0 for the middle, shape (A,)."""
        return np.append(0, 1 + np.arange(self.count - 1) // self.rays)

    @cached_property
    def angles(self) -> Vector:
        """Of the cells' centres, from straight ahead to the left, in [0, 2 pi), shape (A,)."""
        return np.append(0.0, np.arange(self.count - 1) % self.rays * 2 * np.pi / self.rays)

    @cached_property
    def deviations(self) -> Array:
        """Of the cells' centres, ahead and to the left, shape (A, 2) [m]."""
        edges = np.array(self.rings)
        radii = np.append(0.0, (edges[:-1] + edges[1:]) / 2)[self.ring]
        return radii[:, None] * np.column_stack([np.cos(self.angles), np.sin(self.angles)])

    @cached_property
    def log_shares(self) -> Vector:
        """log mu, shape (A,)."""
        squares = np.array((0.0, *self.rings)) ** 2
        areas = np.diff(squares) / squares[-1]
        return np.asarray(np.log(areas[self.ring] / np.where(self.ring > 0, self.rays, 1)))

    def ways(self, before: Array, ahead: Array) -> Array:
        """The ways of a step that moves mean.

        Parameters
        ----------
        before : Array
            Ways of the step before, shape (M, 2) [m].
        ahead : Array
            Where walkers look, unit vectors, shape (M, 2).

        Returns
        -------
        Array
            To the middles of the cells, shape (M, A, 2) [m].
        """
        left = np.column_stack([-ahead[:, 1], ahead[:, 0]])
        along, across = self.deviations.T[:, :, None]
        return np.asarray(before[:, None] + along * ahead[:, None] + across * left[:, None])

    def chosen(self, deviations: Array, ahead: Array) -> Indices:
        """The cells of deviations.

        Parameters
        ----------
        deviations : Array
            Of ways from the ways of the step before, shape (M, 2) [m].
        ahead : Array
            Where walkers look, unit vectors, shape (M, 2).

        Returns
        -------
        Indices
            Shape (M,).
        """
        along = (deviations * ahead).sum(axis=1)
        across = ahead[:, 0] * deviations[:, 1] - ahead[:, 1] * deviations[:, 0]
        ring = np.minimum(np.searchsorted(self.rings, np.hypot(along, across)), len(self.rings) - 1)
        ray = np.rint(np.arctan2(across, along) * self.rays / (2 * np.pi)).astype(np.int64) % self.rays
        return np.where(ring > 0, 1 + (ring - 1) * self.rays + ray, 0)

    def drawn(self, cells: Indices, ahead: Array, rng: np.random.Generator) -> Array:
        """Deviations anywhere in cells, all places alike.

        Parameters
        ----------
        cells : Indices
            Shape (M,).
        ahead : Array
            Where walkers look, unit vectors, shape (M, 2).
        rng : np.random.Generator
            Of the places.

        Returns
        -------
        Array
            Shape (M, 2) [m].
        """
        squares, ring = np.array((0.0, *self.rings)) ** 2, self.ring[cells]
        radii = np.sqrt(squares[ring] + rng.random(len(cells)) * np.diff(squares)[ring])
        spread = np.where(ring > 0, 2 * np.pi / self.rays, 2 * np.pi)
        angles = self.angles[cells] + spread * (rng.random(len(cells)) - 0.5)
        along, across = (radii * np.cos(angles))[:, None], (radii * np.sin(angles))[:, None]
        return np.asarray(along * ahead + across * np.column_stack([-ahead[:, 1], ahead[:, 0]]))
