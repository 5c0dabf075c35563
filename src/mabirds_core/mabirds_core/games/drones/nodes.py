"""Nodes of a lattice in the arena, the moves from any place to the nodes within reach, and mu of each move.

Nodes are o + k_1 b_1 + k_2 b_2 for whole numbers k, as far as they are in the arena. Hexagonal: b_1 and b_2 are equally
long and 60 degrees apart; square: 90 degrees. At any place the actions are "go to a node within reach". The base
measure mu(a) is the share of the disc within reach that is nearer to this node than to the other ones that there are:
it sums to 1, so that without rewards every value is 0 and log pi/mu are nats above the uniform policy.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Literal, NamedTuple

import numpy as np

from mabirds_core.arrays import Array, Indices, Mask
from mabirds_core.games.drones.geometry import disc

Shape = Literal["hexagonal", "square"]

SYMMETRY = {"hexagonal": np.pi / 3, "square": np.pi / 2}
"""Angle of b_1 and b_2; after a rotation by it, a lattice is itself again [rad]."""

COVERING = {"hexagonal": 3**-0.5, "square": 2**-0.5}
"""Largest distance of a place to the nearest node, in spacings."""

IRRATIONAL = np.array([0.7548776662466927, 0.5698402909980532])
"""Multiples of these, modulo 1, are spread evenly over the unit square (Roberts' sequence R_2)."""

SAME_PLACE = 1e-6
"""A place so near to a node is the node [m]; a thousand times the rounding of flights, and far less than a spacing."""

SLACK = 1e-6
"""By how much a move may be longer than the reach, relatively; drones fly it at their largest speed."""

POINTS = 1000
"""Points of the disc by which shares are counted."""


class Moves(NamedTuple):
    """What can be done at M places.

    Attributes
    ----------
    nodes : Indices
        Where each move leads, shape (M, A); -1 where there is no such move.
    shares : Array
        mu, shape (M, A), of sum 1 where there are moves.
    """

    nodes: Indices
    shares: Array

    def at(self, rows: Indices) -> "Moves":
        """Those of some of the places, shape (N,)."""
        return Moves(self.nodes[rows], self.shares[rows])


@dataclass(frozen=True)
class NodeLattice:
    """A lattice over an arena.

    Attributes
    ----------
    arena : tuple[float, float]
        Width and depth [m].
    reach : float
        Longest move [m].
    spacing : float
        Of neighbouring nodes [m], at most the reach.
    shape : Shape
        Hexagonal or square.
    turn : float
        Rotation, as a share of the angle after which the lattice is itself again.
    shift : tuple[float, float]
        Of the nodes along b_1 and b_2, as shares of them.
    """

    arena: tuple[float, float]
    reach: float
    spacing: float
    shape: Shape = "hexagonal"
    turn: float = 0.0
    shift: tuple[float, float] = (0.0, 0.0)

    @classmethod
    def one_of(
        cls, arena: tuple[float, float], reach: float, spacing: float, shape: Shape, number: int, count: int
    ) -> "NodeLattice":
        """One of a set of lattices that are rotated and shifted evenly against each other.

        Parameters
        ----------
        arena : tuple[float, float]
            Width and depth [m].
        reach : float
            Longest move [m].
        spacing : float
            Of neighbouring nodes [m].
        shape : Shape
            Hexagonal or square.
        number : int
            Which of them, from 0.
        count : int
            How many there are.

        Returns
        -------
        NodeLattice
            Never aligned with the arena.
        """
        x, y = (number + 0.5) * IRRATIONAL % 1
        return cls(arena, reach, spacing, shape, (number + 0.5) / count, (float(x), float(y)))

    @cached_property
    def basis(self) -> Array:
        """b_1 and b_2 as rows, shape (2, 2) [m]."""
        symmetry = SYMMETRY[self.shape]
        angles = symmetry * (self.turn + np.arange(2))
        # Rounded, as sine and cosine differ in their last bits between processors.
        return np.asarray(self.spacing * np.round(np.column_stack([np.cos(angles), np.sin(angles)]), 12))

    @cached_property
    def coordinates(self) -> Indices:
        """k_1 and k_2 of the nodes in the arena, counted from the least ones, shape (S, 2)."""
        return np.argwhere(self._numbers >= 0)

    @cached_property
    def places(self) -> Array:
        """Of the nodes, shape (S, 2) [m]."""
        return np.clip(self._places(self.coordinates + self._least), 0.0, self.arena)

    @cached_property
    def moves(self) -> Moves:
        """At every node."""
        return self.moves_from(self.places)

    def nearest(self, places: Array) -> tuple[Indices, Array]:
        """The nearest node.

        Parameters
        ----------
        places : Array
            Shape (M, 2) [m].

        Returns
        -------
        nodes : Indices
            Numbers, shape (M,).
        distances : Array
            To them, shape (M,) [m].
        """
        nodes = self._number(self._nearest(places))
        for lost in np.flatnonzero(nodes < 0):  # beside a wall, behind which the nearest point of the lattice is
            nodes[lost] = _length(self.places - places[lost]).argmin()
        return nodes, _length(self.places[nodes] - places)

    def lengths(self, k: Indices) -> Array:
        """|k_1 b_1 + k_2 b_2| for k of shape (..., 2), shape (...) [m]."""
        return _length(self._along(k))

    def moves_from(self, places: Array) -> Moves:
        """What can be done at any places.

        Parameters
        ----------
        places : Array
            Shape (M, 2) [m].

        Returns
        -------
        Moves
            To the nodes within reach, at least one each.

        Raises
        ------
        ValueError
            At one of them nothing can be done.
        """
        k = self._nearest(places)[:, None] + self._around
        ways = self._places(k) - places[:, None]
        nodes = np.where(_length(ways) <= self.reach * (1 + SLACK), self._number(k), -1)
        order = np.argsort(nodes < 0, axis=1, kind="stable")
        width = int((nodes >= 0).sum(axis=1).max(initial=1))
        nodes = np.take_along_axis(nodes, order, axis=1)[:, :width]
        ways = np.take_along_axis(ways, order[:, :, None], axis=1)[:, :width]
        if (nodes < 0).all(axis=1).any():
            where = places[(nodes < 0).all(axis=1)][0].round(3).tolist()
            raise ValueError(f"no node of the lattice is within {self.reach:g} m of {where}; take a smaller spacing")
        return Moves(nodes, self._shares(ways, nodes >= 0))

    def _shares(self, ways: Array, there: Mask) -> Array:
        """Of moves (M, A, 2), where there are such: counted once for moves that are alike."""
        keys = np.round(np.where(there[..., None], ways, np.inf) / self.spacing, 6).reshape(len(ways), -1)
        _, first, which = np.unique(keys, axis=0, return_index=True, return_inverse=True)
        return np.asarray(_shares(ways[first], there[first], self.reach)[which.ravel()])

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.basis), dtype=np.float64)

    @cached_property
    def _least(self) -> Indices:
        """The least k of nodes that may be in the arena, shape (2,)."""
        return self._bounds[0]

    @cached_property
    def _bounds(self) -> tuple[Indices, Indices]:
        corners = np.array([[x, y] for x in (0.0, self.arena[0]) for y in (0.0, self.arena[1])])
        k = self._real(corners)
        return np.floor(k.min(axis=0)).astype(np.int64) - 1, np.ceil(k.max(axis=0)).astype(np.int64) + 1

    @cached_property
    def _numbers(self) -> Indices:
        """By k less the least one: the number of the node, or -1 outside the arena."""
        low, high = self._bounds
        k = np.stack(np.meshgrid(*(np.arange(a, b + 1) for a, b in zip(low, high, strict=True)), indexing="ij"), -1)
        outside = np.abs(self._places(k) - np.array(self.arena) / 2) - np.array(self.arena) / 2
        inside = outside.max(axis=-1) <= SAME_PLACE
        return np.where(inside, np.cumsum(inside).reshape(inside.shape) - 1, -1)

    @cached_property
    def _around(self) -> Indices:
        """k of all nodes that may be within reach of a place whose nearest one is k = 0, shape (B, 2)."""
        width = int(np.ceil(self.reach / self.spacing)) + 2
        k = np.stack(np.meshgrid(*2 * [np.arange(-2 * width, 2 * width + 1)], indexing="ij"), -1).reshape(-1, 2)
        lengths = self.lengths(k)
        near = lengths <= self.reach * (1 + SLACK) + COVERING[self.shape] * self.spacing
        return k[near][np.argsort(np.round(lengths[near] / self.spacing, 6), kind="stable")]

    def _number(self, k: Indices) -> Indices:
        """Of the nodes, -1 outside the arena."""
        at = k - self._least
        inside: Mask = np.all((at >= 0) & (at < self._numbers.shape), axis=-1, keepdims=True)
        return np.where(inside[..., 0], self._numbers[tuple(np.moveaxis(np.where(inside, at, 0), -1, 0))], -1)

    def _along(self, k: Array | Indices) -> Array:
        """k_1 b_1 + k_2 b_2."""
        return np.asarray(k[..., :1] * self.basis[0] + k[..., 1:] * self.basis[1])

    def _places(self, k: Indices) -> Array:
        return self._along(k + np.array(self.shift))

    def _real(self, places: Array) -> Array:
        """k of places, which need not be whole."""
        along = places[..., :1] * self._inverse[0] + places[..., 1:] * self._inverse[1]
        return np.asarray(along - self.shift)

    def _nearest(self, places: Array) -> Indices:
        """k of the nearest node, in the arena or not: one of the corners of the cell around each place."""
        corners = np.floor(self._real(places)).astype(np.int64)[..., None, :] + np.array(
            [[0, 0], [0, 1], [1, 0], [1, 1]]
        )
        best = _length(self._places(corners) - places[..., None, :]).argmin(axis=-1)
        return np.asarray(np.take_along_axis(corners, best[..., None, None], axis=-2)[..., 0, :])


def _length(vectors: Array) -> Array:
    return np.asarray(np.sqrt(vectors[..., 0] ** 2 + vectors[..., 1] ** 2))


def _shares(ways: Array, there: Mask, reach: float) -> Array:
    """Shares of the disc that are nearest to each way, shape (M, A)."""
    points = disc((0.0, 0.0), reach, POINTS)
    shares = np.zeros(there.shape)
    for row, (some, known) in enumerate(zip(ways, there, strict=True)):
        away = (points[:, :1] - some[known, 0]) ** 2 + (points[:, 1:] - some[known, 1]) ** 2
        shares[row, known] = np.bincount(away.argmin(axis=1), minlength=int(known.sum())) / POINTS
    return shares
