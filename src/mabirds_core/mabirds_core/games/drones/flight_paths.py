"""Smooth ways from a drone's start to its goal region that pass the obstacle in between on a side of one's choice.

A barrier from the middle of that obstacle to the wall closes the other side. Then, for any arena:

    a shortest way over a lattice finds the gaps between all the other obstacles,
    what it has too much is cut off wherever there is a free view,
    an elastic band makes it smooth, and keeps it off the obstacles:   min_x  sum_k tension |x_k+1 - x_k|^2
        + stiffness |x_k-1 - 2 x_k + x_k+1|^2 + sum_obstacles max(0, reach - |x_k - centre|)^2.
"""

from dataclasses import dataclass
from functools import cache, cached_property
from typing import Self

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import dijkstra

from mabirds_core.arrays import Array, Indices, Mask
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.geometry import closest_approach, swept_distance

Side = int
"""On which side of an obstacle to pass it, seen along the way: LEFT or RIGHT."""
LEFT, RIGHT = 1, -1

SPACING = 0.15
"""Between the points of a way [m]."""
MIN_POINTS, MAX_POINTS = 24, 256
"""Points of a way; fewer are no curve, more take long."""
TENSION, STIFFNESS = 2.0, 8.0
"""Forces of the elastic band."""
PULLS = 60
"""How often the band is pulled towards its rest."""
MAX_NODES = 200
"""Nodes of the lattice along a wall, at most."""


@dataclass(frozen=True)
class FlightPaths:
    """A smooth way for each drone."""

    points: Array
    """At equal distances along each way, shape (N_E, k, 2) [m]."""
    lengths: Array
    """Shape (N_E,) [m]."""

    @classmethod
    def through(cls, points: Array) -> Self:
        """The ways (N_E, k, 2), with as many points that are equally far apart."""
        ways = [resampled(way, len(way)) for way in points]
        return cls(np.stack(ways), np.array([length_of(way) for way in points]))

    def at(self, arcs: Array) -> Array:
        """Places (N_E, k, 2) that far along each way, (N_E, k) [m]; before and behind its ends, the ends."""
        last = self.points.shape[1] - 1
        index = np.clip(arcs / np.maximum(self.lengths, 1e-9)[:, None], 0.0, 1.0) * last
        whole = np.minimum(index.astype(int), last - 1)
        drones, part = np.arange(len(arcs))[:, None], (index - whole)[..., None]
        return np.asarray((1 - part) * self.points[drones, whole] + part * self.points[drones, whole + 1])


@dataclass(frozen=True)
class Corridor:
    """A way of one drone from the middle of its start, and the barrier that keeps it on its side."""

    points: Array
    """Corners, shape (k, 2) [m]; the last is the centre of the goal region."""
    barrier: Array | None
    """Its ends, shape (2, 2) [m]; None where no obstacle is in between."""


class PathPlanner:
    """Plans the ways of a game's drones.

    Parameters
    ----------
    game : DroneGame
        With the obstacles and tasks.
    margin : float
        What is left to each obstacle at the least [m].
    """

    def __init__(self, game: DroneGame, margin: float) -> None:
        settings, radius = game.settings, game.settings.drone_radius
        self._tasks, self._arena = settings.drones, game.arena
        discs = [(barrier.centres(radius), barrier.radius) for barrier in settings.barriers]  # walls are rows of them
        self._centres = np.concatenate([np.empty((0, 2)), *(centres for centres, _ in discs)])
        self._reach = np.concatenate([np.empty(0), *(np.full(len(centres), of + radius) for centres, of in discs)])
        self._keep = self._reach + margin
        self._wall = np.minimum(radius, game.arena / 2)
        self._longest = settings.horizon * settings.time_step * settings.max_speed
        self._spacing = max(radius, max(settings.arena) / MAX_NODES)

    @cached_property
    def corridors(self) -> list[dict[Side, Corridor]]:
        """For each drone, the sides on which it can be in its goal region in time."""
        return [
            {side: way for side in (LEFT, RIGHT) if (way := self._corridor(drone, side)) is not None}
            for drone in range(len(self._tasks))
        ]

    @cached_property
    def _points(self) -> int:
        """Number of points of every way of this game."""
        longest = max(length_of(way.points) for ways in self.corridors for way in ways.values())
        return int(np.clip(longest / SPACING, MIN_POINTS, MAX_POINTS))

    def side_of(self, drone: int, start: Array) -> Side:
        """On which side of the straight way from the middle of its start to its goal region a drone starts.

        Parameters
        ----------
        drone : int
            Index.
        start : Array
            Its place, shape (2,) [m].

        Returns
        -------
        Side
            LEFT or RIGHT.
        """
        middle, goal = self._ends(drone)
        return LEFT if _cross(goal - middle, start - middle) >= 0 else RIGHT

    def paths(self, starts: Array, aims: Array, sides: list[Side], clearance: Array) -> FlightPaths:
        """Plan a way for each drone.

        Parameters
        ----------
        starts : Array
            Shape (N_E, 2) [m].
        aims : Array
            Shape (N_E, 2) [m].
        sides : list[Side]
            On which each drone passes the obstacle in between.
        clearance : Array
            The ways are pushed off obstacles that are nearer, shape (N_E,) [m].

        Returns
        -------
        FlightPaths
            From the starts to the aims.
        """
        corners = []
        for drone, side in enumerate(sides):
            corridor = self.corridors[drone][side]
            way = np.vstack([starts[drone], corridor.points, aims[drone]])
            corners.append(resampled(self._taut(way, corridor.barrier), self._points))
        return FlightPaths.through(self._relaxed(np.stack(corners), clearance))

    def _ends(self, drone: int) -> tuple[Array, Array]:
        task = self._tasks[drone]
        return np.array(task.start), np.array(task.goal_region.centre)

    def _corridor(self, drone: int, side: Side) -> Corridor | None:
        middle, goal = self._ends(drone)
        barrier = self._barrier(middle, goal, side)
        route = self._route(middle, goal, barrier)
        if route is None:
            return None
        way = self._taut(np.vstack([middle, route, goal]), barrier)
        in_time = length_of(way) <= self._longest + self._tasks[drone].goal_region.radius
        return Corridor(way, barrier) if in_time else None

    def _barrier(self, start: Array, goal: Array, side: Side) -> Array | None:
        """From the obstacle deepest in the straight way to beyond the wall, on the other side than ``side``."""
        way = goal - start
        along = (self._centres - start) @ way / max(float(way @ way), 1e-12)
        depth = np.where((along > 0) & (along < 1), self._keep - swept_distance(start, goal, self._centres), -np.inf)
        if not (depth > 0).any():
            return None
        centre = self._centres[depth.argmax()]
        left = np.array([-way[1], way[0]]) / np.hypot(*way)
        return np.stack([centre, centre - side * left * np.hypot(*self._arena)])

    def _route(self, start: Array, goal: Array, barrier: Array | None) -> Array | None:
        """Nodes of a lattice along a shortest way, shape (k, 2); None if there is no way."""
        axes = [np.linspace(0, side, int(np.ceil(side / self._spacing)) + 1) for side in self._arena]
        nodes = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        free = self._free(nodes, barrier)
        if not free.any():
            return None
        first, last = (int(((nodes[free] - point) ** 2).sum(axis=1).argmin()) for point in (start, goal))
        way = shortest_way(free, first, last)
        return None if way is None else nodes[free][way]

    def _free(self, nodes: Array, barrier: Array | None) -> Mask:
        """Which nodes (X, Y, 2) are clear of obstacles, walls and the barrier."""
        clear = ((nodes >= self._wall - 1e-9) & (nodes <= self._arena - self._wall + 1e-9)).all(axis=-1)
        for centre, keep in zip(self._centres, self._keep, strict=True):
            clear &= np.hypot(*np.moveaxis(nodes - centre, -1, 0)) > keep
        if barrier is not None:  # thick enough that no diagonal step leaps over it
            clear &= closest_approach(barrier[0] - nodes, barrier[1] - nodes) > 0.75 * self._spacing
        return np.asarray(clear)

    def _taut(self, way: Array, barrier: Array | None) -> Array:
        """The corners (k, 2) that are left when all are skipped behind which there is a free view of a later one."""
        corners, here = [way[0]], 0
        while here < len(way) - 1:
            seen = np.flatnonzero(self._sees(way[here], way[here + 1 :], barrier))
            here += 1 + (int(seen[-1]) if len(seen) else 0)
            corners.append(way[here])
        return np.array(corners)

    def _sees(self, here: Array, there: Array, barrier: Array | None) -> Mask:
        """To which points (k, 2) the straight segment keeps clear of obstacles and does not cross the barrier."""
        distance = swept_distance(here[None, None], there[:, None], self._centres)
        clear = (distance > self._keep).all(axis=1)
        return np.asarray(clear if barrier is None else clear & ~_crosses(here, there, barrier))

    def _relaxed(self, points: Array, clearance: Array) -> Array:
        """The elastic bands (N_E, k, 2) at rest, nearly; their ends stay."""
        pull, reach = band_smoother(points.shape[1]), self._reach + clearance[:, None, None]
        low = np.minimum(self._wall, points.min(axis=(0, 1)))
        high = np.maximum(self._arena - self._wall, points.max(axis=(0, 1)))
        for _ in range(PULLS):
            offset = points[:, :, None] - self._centres
            distance = np.sqrt((offset**2).sum(axis=-1))
            push = np.maximum(reach - distance, 0.0) / np.maximum(distance, 1e-9)
            pushed = points + 0.5 * (push[..., None] * offset).sum(axis=2)
            pushed[:, [0, -1]] = points[:, [0, -1]]
            points = pull @ np.clip(pushed, low, high)
        return points


def shortest_way(free: Mask, first: int, last: int) -> Indices | None:
    """A shortest way over a lattice, by steps to the eight neighbours.

    Parameters
    ----------
    free : Mask
        Which nodes may be on the way, shape (X, Y).
    first : int
        Where it starts: a node by its number among the free ones, row by row.
    last : int
        Where it ends, likewise.

    Returns
    -------
    Indices or None
        The nodes by their numbers, shape (k,); None if there is no way.

    Examples
    --------
    >>> free = np.array([[True, True, True], [False, False, True], [True, True, True]])
    >>> shortest_way(free, 0, 4).tolist()
    [0, 1, 3, 5, 4]
    """
    _, before = dijkstra(_steps(free), directed=False, indices=[last], return_predecessors=True)
    way = [first]
    while way[-1] != last:
        if before[0, way[-1]] < 0:
            return None
        way.append(int(before[0, way[-1]]))
    return np.array(way)


def _steps(free: Mask) -> "coo_array[np.float64]":
    """Lengths of the steps between free nodes, each in one direction, shape (free nodes, free nodes)."""
    width = free.shape[1] + 2  # with a border that is not free all nodes have eight neighbours
    rows, columns = np.nonzero(free)
    place, number = (rows + 1) * width + columns + 1, np.full((free.shape[0] + 2) * width, -1)
    number[place] = np.arange(len(place))
    nodes, others, lengths = [], [], []
    for row, column in ((0, 1), (1, 0), (1, 1), (1, -1)):
        beside = number[place + row * width + column]
        nodes.append(np.flatnonzero(beside >= 0))
        others.append(beside[beside >= 0])
        lengths.append(np.full(len(nodes[-1]), np.hypot(row, column)))
    ends = (np.concatenate(nodes), np.concatenate(others))
    return coo_array((np.concatenate(lengths), ends), shape=(len(place), len(place)))


def length_of(way: Array) -> float:
    """Length of a way (k, 2)."""
    return float(np.hypot(*np.diff(way, axis=0).T).sum())


def resampled(way: Array, count: int) -> Array:
    """Points at equal distances along a way.

    Parameters
    ----------
    way : Array
        Shape (k, 2).
    count : int
        How many points.

    Returns
    -------
    Array
        Shape (count, 2).
    """
    arcs = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(way, axis=0).T))])
    there = np.linspace(0.0, arcs[-1], count)
    return np.stack([np.interp(there, arcs, axis) for axis in way.T], axis=1)


@cache
def band_smoother(count: int) -> Array:
    """What one implicit step of tension and stiffness makes of ``count`` points whose ends stay, (count, count)."""
    first, second = np.diff(np.eye(count), axis=0), np.diff(np.eye(count), n=2, axis=0)
    force = TENSION * first.T @ first + STIFFNESS * second.T @ second
    force[[0, -1]] = 0.0
    return np.asarray(np.linalg.inv(np.eye(count) + force))


def _cross(a: Array, b: Array) -> Array:
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _crosses(here: Array, there: Array, barrier: Array) -> Mask:
    """Which of the straight segments to (k, 2) cross the barrier (2, 2)."""
    near, far = barrier
    across = _cross(far - near, here - near) * _cross(far - near, there - near) < 0
    return np.asarray(across & (_cross(there - here, near - here) * _cross(there - here, far - here) < 0))
