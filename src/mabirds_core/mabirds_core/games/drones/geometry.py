"""Distances of drones that fly straight from one step to the next, in closed form; metres throughout."""

from typing import Any

import numpy as np

from mabirds_core.arrays import Array


def squared_length(vectors: Any) -> Any:
    """x^2 + y^2, for numpy and torch alike: five times as fast as a sum along an axis of two.

    Parameters
    ----------
    vectors : Any
        Shape (..., 2).

    Returns
    -------
    Any
        Shape (...).
    """
    return vectors[..., 0] ** 2 + vectors[..., 1] ** 2


def closest_approach(start: Array, end: Array) -> Array:
    """Least distance from the origin to straight segments.

    Parameters
    ----------
    start : Array
        Shape (..., 2).
    end : Array
        Shape (..., 2).

    Returns
    -------
    Array
        Shape (...).

    Examples
    --------
    >>> float(closest_approach(np.array([-1.0, 0.5]), np.array([1.0, 0.5])))
    0.5
    """
    way = end - start
    length = (way**2).sum(axis=-1)
    # The point start + s way with the least distance; a segment of no length is its start.
    s = np.clip(-(start * way).sum(axis=-1) / np.where(length > 0, length, 1.0), 0.0, 1.0)
    return np.asarray(np.sqrt(((start + s[..., None] * way) ** 2).sum(axis=-1)))


def swept_distance(start: Array, end: Array, centre: Array) -> Array:
    """Least distance of straight segments to a point at rest.

    Parameters
    ----------
    start : Array
        Shape (..., 2).
    end : Array
        Shape (..., 2).
    centre : Array
        The point, shape (..., 2).

    Returns
    -------
    Array
        Shape (...).
    """
    return closest_approach(start - centre, end - centre)


def segment_distance(start: Array, end: Array, first: Array, second: Array) -> Array:
    """Least distance of straight segments to another one.

    Parameters
    ----------
    start : Array
        Shape (..., 2).
    end : Array
        Shape (..., 2).
    first : Array
        An end of the other one, shape (2,).
    second : Array
        Its other end, shape (2,); the same one makes it a point.

    Returns
    -------
    Array
        Shape (...); 0 where they cross.
    """
    ends = [swept_distance(start, end, at) for at in (first, second)]
    ends += [swept_distance(first, second, at) for at in (start, end)]
    apart = np.minimum.reduce(ends)

    def side(of: Array, to: Array, at: Array) -> Array:
        (x, y), (u, v) = np.moveaxis(to - of, -1, 0), np.moveaxis(at - of, -1, 0)
        return np.asarray(x * v - y * u)

    crosses = side(start, end, first) * side(start, end, second) < 0
    crosses &= side(first, second, start) * side(first, second, end) < 0
    return np.asarray(np.where(crosses, 0.0, apart))


def swept_separation(starts: tuple[Array, Array], ends: tuple[Array, Array]) -> Array:
    """Least distance of two drones that fly straight at the same time: of their difference to zero.

    Parameters
    ----------
    starts : tuple[Array, Array]
        Of the two, shape (..., 2) each.
    ends : tuple[Array, Array]
        Of the two, shape (..., 2) each.

    Returns
    -------
    Array
        Shape (...).
    """
    return closest_approach(starts[0] - starts[1], ends[0] - ends[1])


def disc(centre: tuple[float, float], radius: float, points: int) -> Array:
    """Places spread evenly over a disc (a sunflower's seeds).

    Parameters
    ----------
    centre : tuple[float, float]
        x and y [m].
    radius : float
        In metres.
    points : int
        How many.

    Returns
    -------
    Array
        Shape (points, 2) [m].
    """
    numbers = np.arange(points)
    angles, radii = np.pi * (1 + np.sqrt(5)) * numbers, radius * np.sqrt((numbers + 0.5) / points)
    return np.asarray(centre + radii[:, None] * np.column_stack([np.cos(angles), np.sin(angles)]))


def rim(centre: tuple[float, float], radius: float, points: int) -> Array:
    """Places on the border of a disc.

    Parameters
    ----------
    centre : tuple[float, float]
        x and y [m].
    radius : float
        In metres.
    points : int
        How many.

    Returns
    -------
    Array
        Shape (points, 2) [m].
    """
    angles = 2 * np.pi * np.arange(points) / points
    return np.asarray(centre + radius * np.column_stack([np.cos(angles), np.sin(angles)]))
