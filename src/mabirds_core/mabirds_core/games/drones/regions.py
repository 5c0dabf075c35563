"""Discs and segments with a radius: goal regions, doors, obstacles and walls; metres throughout."""

from typing import Annotated

import numpy as np
from pydantic import Field, model_validator

from mabirds_core.arrays import Array, Mask
from mabirds_core.games.drones.geometry import disc, rim, segment_distance, squared_length
from mabirds_core.settings import Settings

Point = tuple[float, float]
Length = Annotated[float, Field(ge=1e-6, le=1000)]


class Region(Settings):
    """A disc, or all places within ``radius`` of the segment from ``centre`` to ``until``."""

    centre: Point = Field(description="x, y [m]")
    radius: Length = Field(description="[m]")
    until: Point | None = Field(None, description="of a door or wall, where its other end is [m]")

    @property
    def way(self) -> Array:
        """From one end of the segment to the other, shape (2,) [m]; zeros for a disc."""
        return np.zeros(2) if self.until is None else np.subtract(self.until, self.centre)

    @property
    def ends(self) -> tuple[Point, Point]:
        """Of the segment; the centre twice for a disc."""
        return self.centre, self.until or self.centre

    def nearest(self, places: Array) -> Array:
        """The places of the segment that are nearest to places, shape (..., 2) each [m]; the centre of a disc."""
        if self.until is None:
            return np.broadcast_to(np.array(self.centre), places.shape)
        along = ((places - self.centre) @ self.way) / (self.way @ self.way)
        return np.asarray(self.centre + np.clip(along, 0.0, 1.0)[..., None] * self.way)

    def away(self, places: Array) -> Array:
        """Squared distances to the segment, or to the centre of a disc, shape (...) [m^2]."""
        return np.asarray(squared_length(places - self.nearest(places)))

    @model_validator(mode="after")
    def _is_no_point(self) -> "Region":
        if self.until == self.centre:
            raise ValueError(f"until {self.until}: expected another place than centre; leave it out for a disc")
        return self


class GoalRegion(Region):
    """A goal region, or a door."""


class Obstacle(Region):
    """What drones may not touch: a disc, or a wall."""

    def clearance(self, start: Array, end: Array) -> Array:
        """Metres between the obstacle and straight flights of a point.

        Parameters
        ----------
        start : Array
            Shape (..., 2) [m].
        end : Array
            Shape (..., 2) [m].

        Returns
        -------
        Array
            Shape (...); negative: the way leads into it.
        """
        return segment_distance(start, end, *map(np.array, self.ends)) - self.radius

    def centres(self, spacing: float) -> Array:
        """Places along the segment, ends among them, no further apart than ``spacing``; shape (n, 2) [m]."""
        count = 1 if self.until is None else int(np.ceil(np.hypot(*self.way) / spacing)) + 1
        return np.linspace(*self.ends, count)

    def places(self, margin: float, count: int) -> Array:
        """Places spread over the obstacle.

        Parameters
        ----------
        margin : float
            By how much it is widened [m].
        count : int
            How many.

        Returns
        -------
        Array
            Shape (count, 2) [m].
        """
        golden = np.arange(count) * (np.sqrt(5) - 1) / 2 % 1
        return np.asarray(disc(self.centre, self.radius + margin, count) + golden[:, None] * self.way)

    def outline(self, margin: float, count: int) -> Array:
        """Places evenly on its rim, in order.

        Parameters
        ----------
        margin : float
            By how much it is widened [m].
        count : int
            How many.

        Returns
        -------
        Array
            Shape (count, 2) [m].
        """
        side = self.radius + margin
        if self.until is None:
            return rim(self.centre, side, count)
        along = self.way / np.hypot(*self.way)
        across = np.array([-along[1], along[0]])
        straight, bend = np.hypot(*self.way), np.pi * side
        at = np.arange(count) / count * 2 * (straight + bend)
        back = at >= straight + bend
        way, turn = np.where(back, -1.0, 1.0), at - back * (straight + bend)
        forward, angle = np.minimum(turn, straight), np.maximum(turn - straight, 0.0) / side
        from_ = np.where(back[:, None], self.until, self.centre) + (way * forward)[:, None] * along
        outward = -np.cos(angle)[:, None] * across + np.sin(angle)[:, None] * along
        return np.asarray(from_ + side * way[:, None] * outward)


def inside(corners: Array, places: Array) -> Mask:
    """Which places are inside a polygon, by how often a ray to the right crosses its rim.

    Parameters
    ----------
    corners : Array
        Shape (n, 2) [m]; the last one may repeat the first.
    places : Array
        Shape (..., 2) [m].

    Returns
    -------
    Mask
        Shape (...).
    """
    x, y = places[..., 0, None], places[..., 1, None]
    (x0, y0), (x1, y1) = corners.T, np.roll(corners, -1, axis=0).T
    spans = (y0 > y) != (y1 > y)
    crossing = x0 + (y - y0) * (x1 - x0) / np.where(y1 == y0, 1.0, y1 - y0)
    return np.asarray((spans & (x < crossing)).sum(axis=-1) % 2 == 1)
