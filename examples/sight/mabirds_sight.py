"""A cost feature from outside: pairs of patrollers who see each other, which no expression can say.

Two see each other within ``reach`` cells where the line between the middles of their cells meets no cell of ``walls``.
"""

from itertools import combinations
from typing import Literal

import numpy as np
from pydantic import Field

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.games.patrol.named_costs import JointPlaces
from mabirds_core.registry import Kind
from mabirds_core.settings import Settings

HALF = 0.5
"""Of a cell's side."""


class InSightSettings(Settings):
    """How many pairs of experts see each other past walls."""

    kind: Literal["in_sight"]
    reach: float = Field(5.0, gt=0, le=1000, description="how far experts see [cells]")
    walls: tuple[tuple[int, int], ...] = Field((), max_length=10_000, description="cells that nobody sees through")


def in_sight(settings: InSightSettings, places: JointPlaces) -> Vector:
    """Pairs in sight of each other in every joint state, shape (S,)."""
    pairs = np.zeros(places.rows.shape[1])
    for i, j in combinations(range(len(places.rows)), 2):
        here, there = (np.stack([places.rows[k], places.columns[k]]) for k in (i, j))
        near = np.sqrt(((there - here) ** 2).sum(axis=0)) <= settings.reach
        pairs += near & places.present[i] & places.present[j] & ~_hidden(here, there, settings.walls)
    return pairs


def _hidden(here: Array, there: Array, walls: tuple[tuple[int, int], ...]) -> Mask:
    """Does the line from one place to the other meet a wall? Places have the shape (2, S)."""
    hidden = np.zeros(here.shape[1], dtype=np.bool_)
    for wall in walls:
        hidden |= _crosses(here - np.array(wall)[:, None], there - here)
    return hidden


def _crosses(start: Array, way: Array) -> Mask:
    """Is start + t way, 0 <= t <= 1, inside the square |row|, |column| < HALF for some t?

    Each axis is inside for t between two bounds; so are both, where the latest entry is before the first exit.
    """
    still = way == 0
    along = np.where(still, 1.0, way)
    bounds = np.sort(np.stack([(-HALF - start) / along, (HALF - start) / along]), axis=0)
    never = still & (np.abs(start) >= HALF)
    enters = np.where(still, 0.0, bounds[0]).max(axis=0)
    leaves = np.where(still, 1.0, bounds[1]).min(axis=0)
    return np.asarray((np.maximum(enters, 0.0) < np.minimum(leaves, 1.0)) & ~never.any(axis=0))


IN_SIGHT = Kind(InSightSettings, in_sight)
