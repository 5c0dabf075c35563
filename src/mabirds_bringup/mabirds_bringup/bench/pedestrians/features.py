"""What a step is judged by: features of a move in a situation, none of them negative.

    r(s, a) = theta^T f(s, a) + omega^T phi(s, a)

f: by how much and whither the way differs from the one before, by ring and sector, for slow and for fast walkers; the
speed and the direction against that of the role; and, for each role, places.
phi, the same for both roles: places, and how near the other one is.

Places and nearness are those of now and of the LOOKAHEAD next steps if both went on with unchanged velocity,
sum_h gamma^h g(p_h) / sum_h gamma^h: one step of policy improvement over constant velocity. Exact planning to the end
would need the velocities of both in the state, 10^7 joint states even on a coarse grid. Between points of a grid,
places are told by bilinear weights.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from scipy.sparse import coo_array, csr_array, hstack

from mabirds_bringup.bench.pedestrians.moves import Moves
from mabirds_bringup.bench.pedestrians.situations import Situations
from mabirds_core.arrays import Array, Indices, Vector

DISCOUNT = 0.8
"""gamma."""

FAST = 0.4
"""Who goes less in a step is slow [m]."""

SPEEDS = np.arange(0.0, 2.01, 0.25)
"""Ways of a step that are told apart [m]."""

TURNS = np.linspace(0.0, np.pi, 9)
"""Directions against that of the role."""

SECTORS = 3
"""Ahead, to a side, back."""

LEVELS = (0.5, 0.75, 1.0, 1.5, 2.0, 3.0)
"""Distances within which the other one is near [m]."""

SOFTNESS = 0.1
"""Over which nearness falls [m]."""


@dataclass(frozen=True)
class PlaceGrid:
    """Points over a rectangle."""

    low: tuple[float, float]
    high: tuple[float, float]
    spacing: float

    @cached_property
    def shape(self) -> tuple[int, int]:
        """Points along x and y."""
        x, y = (int(np.ceil((b - a) / self.spacing)) + 1 for a, b in zip(self.low, self.high, strict=True))
        return x, y

    @property
    def size(self) -> int:
        """How many."""
        return self.shape[0] * self.shape[1]

    @cached_property
    def points(self) -> Array:
        """Shape (size, 2) [m]."""
        axes = [a + self.spacing * np.arange(n) for a, n in zip(self.low, self.shape, strict=True)]
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)

    def corners(self, places: Array) -> Iterator[tuple[Indices, Array]]:
        """The four points around places (..., 2) and their weights; what is outside has none."""
        at = (places - np.array(self.low)) / self.spacing
        below = np.floor(at).astype(np.int64)
        part = at - below
        for right in (0, 1):
            for up in (0, 1):
                x, y = below[..., 0] + right, below[..., 1] + up
                weight = np.abs(1 - right - part[..., 0]) * np.abs(1 - up - part[..., 1])
                inside = (x >= 0) & (x < self.shape[0]) & (y >= 0) & (y < self.shape[1])
                yield np.where(inside, x * self.shape[1] + y, 0), np.where(inside, weight, 0.0)


class Tables(NamedTuple):
    """Features of M situations and A moves.

    Attributes
    ----------
    reward, cost : csr_array
        f and phi, shape (M A, K).
    """

    reward: csr_array
    cost: csr_array


@dataclass(frozen=True)
class WalkFeatures:
    """f and phi."""

    moves: Moves
    headings: Array
    aims: PlaceGrid
    """Of f."""
    spots: PlaceGrid
    """Of phi."""
    lookahead: int = 5
    """Steps."""

    @cached_property
    def reward_names(self) -> tuple[str, ...]:
        """Of f."""
        kinds = [
            f"deviation ring {ring}, {sector}, {pace}"
            for pace in ("slow", "fast")
            for ring in range(len(self.moves.rings))
            for sector in ("ahead", "aside", "back")
        ]
        speeds = [f"step of {way:g} m" for way in SPEEDS]
        turns = [f"{np.degrees(turn):.0f} degrees off" for turn in TURNS]
        aims = [f"role {role} to ({x:g}, {y:g}) m" for role in (1, 2) for x, y in self.aims.points]
        return (*kinds, *speeds, *turns, *aims)

    @cached_property
    def cost_names(self) -> tuple[str, ...]:
        """Of phi."""
        spots = [f"near ({x:g}, {y:g}) m" for x, y in self.spots.points]
        return (*spots, *(f"within {level:g} m of the other" for level in LEVELS))

    def tables(self, situations: Situations) -> Tables:
        """Features of all moves in some situations."""
        ways = self.moves.ways(situations.before, situations.ahead)
        return Tables(
            hstack([self._habits(situations, ways), self._aims(situations, ways)], format="csr"),
            hstack([self._spots(situations, ways), self._nearness(situations, ways)], format="csr"),
        )

    def _habits(self, situations: Situations, ways: Array) -> csr_array:
        """Deviation, speed and direction."""
        shape, speed = ways.shape[:2], np.hypot(ways[..., 0], ways[..., 1])
        off = np.abs(self.moves.angles + np.pi) % (2 * np.pi) - np.pi
        sector = np.searchsorted([np.pi / 4, 3 * np.pi / 4], np.abs(off))
        kind = self.moves.ring * SECTORS + np.where(self.moves.ring > 0, sector, 0)
        fast = np.hypot(*situations.before.T) >= FAST
        kinds = kind + fast[:, None] * len(self.moves.rings) * SECTORS
        heading = (ways * self.headings[situations.role][:, None]).sum(axis=-1) / np.maximum(speed, 1e-9)
        turn = np.arccos(np.clip(heading, -1.0, 1.0))
        counts = 2 * len(self.moves.rings) * SECTORS
        blocks = [
            _sparse([(kinds, np.ones(shape))], counts),
            _sparse(_hats(speed, SPEEDS), len(SPEEDS)),
            _sparse(_hats(turn, TURNS, np.minimum(1.0, speed / FAST)), len(TURNS)),
        ]
        return hstack(blocks, format="csr")

    def _aims(self, situations: Situations, ways: Array) -> csr_array:
        first = situations.role[:, None] * self.aims.size
        parts = [
            (first + points, weight * weights)
            for weight, places in self._ahead(situations, ways)
            for points, weights in self.aims.corners(places)
        ]
        return _sparse(parts, 2 * self.aims.size)

    def _spots(self, situations: Situations, ways: Array) -> csr_array:
        parts = [
            (points, weight * weights)
            for weight, places in self._ahead(situations, ways)
            for points, weights in self.spots.corners(places)
        ]
        return _sparse(parts, self.spots.size)

    def _ahead(self, situations: Situations, ways: Array) -> Iterator[tuple[float, Array]]:
        """gamma^h, of sum 1, and where walkers are after 1 + h steps, shape (M, A, 2)."""
        weights = DISCOUNT ** np.arange(self.lookahead + 1)
        for h, weight in enumerate(weights / weights.sum()):
            yield float(weight), situations.places[:, None] + (1 + h) * ways

    def _nearness(self, situations: Situations, ways: Array) -> csr_array:
        total = np.zeros((*ways.shape[:2], len(LEVELS)))
        for h, (weight, places) in enumerate(self._ahead(situations, ways)):
            others = situations.other_places + (1 + h) * situations.other_before
            apart = np.hypot(*np.moveaxis(places - others[:, None], -1, 0))
            beyond = np.minimum((apart[..., None] - np.array(LEVELS)) / SOFTNESS, 50.0)
            total += weight / (1 + np.exp(beyond))
        total *= situations.met[:, None, None]
        total[total < 1e-6] = 0.0
        return csr_array(total.reshape(-1, len(LEVELS)))


def _hats(values: Array, points: Vector, weights: Array | float = 1.0) -> list[tuple[Indices, Array]]:
    """The two points around values (..., ) and their weights; beyond the last point, that one."""
    at = np.clip(values / (points[1] - points[0]), 0.0, len(points) - 1.0)
    below = np.minimum(at.astype(np.int64), len(points) - 2)
    return [(below, weights * (1 - at + below)), (below + 1, weights * (at - below))]


def _sparse(parts: list[tuple[Indices, Array]], columns: int) -> csr_array:
    """Rows of features from parts of one number each in a row, shape (M A, columns)."""
    rows = np.arange(parts[0][0].size)
    data = np.concatenate([weights.ravel() for _, weights in parts])
    at = np.concatenate([points.ravel() for points, _ in parts])
    table = coo_array((data, (np.tile(rows, len(parts)), at)), shape=(len(rows), columns)).tocsr()
    table.eliminate_zeros()
    return csr_array(table)
