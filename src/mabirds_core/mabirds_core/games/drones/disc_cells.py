"""Cells of the disc of a drone's actions: rings of sectors, with which continuous actions are drawn and weighed.

All cells of a ring have the same share of mu, the uniform measure of the disc. Actions are of length 1 at most here.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_core.arrays import Array, Indices, Vector


@dataclass(frozen=True)
class DiscCells:
    """K = rings x sectors cells, of P = parts x parts parts each.

    Attributes
    ----------
    rings : int
        Their edges are those of the shares of Gauss' quadrature along the squared radius.
    sectors : int
        Of each ring.
    parts : int
        Of each side of a cell; all have the same share of it.
    """

    rings: int = 5
    sectors: int = 16
    parts: int = 4

    @property
    def count(self) -> int:
        """K."""
        return self.rings * self.sectors

    @cached_property
    def points(self) -> Array:
        """A point of each cell, those of the quadrature, shape (K, 2)."""
        squares, _ = np.polynomial.legendre.leggauss(self.rings)
        return self._polar(
            np.repeat((squares + 1) / 2, self.sectors), np.tile(np.arange(self.sectors) + 0.5, self.rings)
        )

    @cached_property
    def shares(self) -> Vector:
        """Of mu, shape (K,)."""
        return np.repeat(np.diff(self._edges) / self.sectors, self.sectors)

    @cached_property
    def middles(self) -> Array:
        """Of the parts of each cell, shape (K, P, 2)."""
        cells, numbers = np.indices((self.count, self.parts**2))
        return self._within(cells, numbers, 0.5, 0.5)

    def places(self, cells: Indices, parts: Indices, rng: np.random.Generator) -> Array:
        """Draw actions, uniform in parts of cells.

        Parameters
        ----------
        cells : Indices
            Shape (M,).
        parts : Indices
            Of these cells, shape (M,).
        rng : np.random.Generator
            Of the draw.

        Returns
        -------
        Array
            Shape (M, 2).
        """
        return self._within(cells, parts, rng.random(len(cells)), rng.random(len(cells)))

    @cached_property
    def _edges(self) -> Vector:
        """Squared radii between the rings, shape (rings + 1,)."""
        _, shares = np.polynomial.legendre.leggauss(self.rings)
        return np.append(0.0, (shares / 2).cumsum())

    def _within(self, cells: Indices, parts: Indices, across: Array | float, along: Array | float) -> Array:
        """What is ``across`` and ``along``, from 0 to 1, in parts of cells."""
        (ring, sector), (row, column) = np.divmod(cells, self.sectors), np.divmod(parts, self.parts)
        inner, outer = self._edges[ring], self._edges[ring + 1]
        return self._polar(
            inner + (outer - inner) * (row + across) / self.parts, sector + (column + along) / self.parts
        )

    def _polar(self, squares: Array, sectors: Array) -> Array:
        """By squared radius, and by the angle in sectors."""
        angles = 2 * np.pi * sectors / self.sectors
        return np.asarray(np.sqrt(squares)[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1))
