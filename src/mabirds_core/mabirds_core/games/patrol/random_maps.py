"""Random patrols: hallways, rooms and mazes with several joint starts, that experts can walk in time."""

from collections.abc import Callable

import networkx as nx
import numpy as np
from numpy.typing import NDArray

from mabirds_core.games.patrol.settings import PatrolSettings

Walls = NDArray[np.bool_]

STEP_COSTS = (0.3, 1.0)
"""Where steps cost less, experts stroll until the deadline forces them, which no reward of states and actions says."""
TRIES = 200
"""Draws of joint starts, and of maps, before another is tried."""


def hallways(rng: np.random.Generator, height: int, width: int) -> Walls:
    """Corridors with one bend each, which join four or five places to a loop.

    Parameters
    ----------
    rng : np.random.Generator
        Of places and bends.
    height : int
        Rows.
    width : int
        Columns.

    Returns
    -------
    Walls
        True where a wall is, shape (height, width).
    """
    walls = np.ones((height, width), dtype=bool)
    places = [(int(rng.integers(1, height - 1)), int(rng.integers(1, width - 1))) for _ in range(rng.integers(4, 6))]
    for (row, column), (to_row, to_column) in zip(places, places[1:] + places[:1], strict=True):
        rows = slice(min(row, to_row), max(row, to_row) + 1)
        columns = slice(min(column, to_column), max(column, to_column) + 1)
        bend_row, bend_column = (row, to_column) if rng.random() < 0.5 else (to_row, column)
        walls[bend_row, columns] = walls[rows, bend_column] = False
    return walls


def rooms(rng: np.random.Generator, height: int, width: int) -> Walls:
    """Four rooms, each wall between two with a door.

    Parameters
    ----------
    rng : np.random.Generator
        Of walls and doors.
    height : int
        Rows.
    width : int
        Columns.

    Returns
    -------
    Walls
        True where a wall is, shape (height, width).
    """
    walls = np.ones((height, width), dtype=bool)
    walls[1:-1, 1:-1] = False
    row, column = int(rng.integers(2, height - 2)), int(rng.integers(2, width - 2))
    walls[row, 1:-1] = walls[1:-1, column] = True
    for rows in (range(1, row), range(row + 1, height - 1)):
        walls[rng.choice(rows), column] = False
    for columns in (range(1, column), range(column + 1, width - 1)):
        walls[row, rng.choice(columns)] = False
    return walls


def maze(rng: np.random.Generator, height: int, width: int) -> Walls:
    """A random spanning tree of corridors, a quarter of the other passages opened.

    Parameters
    ----------
    rng : np.random.Generator
        Of the tree and the passages.
    height : int
        Rows; an even number becomes the next odd one.
    width : int
        Columns; likewise.

    Returns
    -------
    Walls
        True where a wall is, shape (height, width) or one more.
    """
    walls = np.ones((height | 1, width | 1), dtype=bool)
    grid = nx.grid_2d_graph(height // 2, width // 2)
    nx.set_edge_attributes(grid, {edge: float(rng.random()) for edge in grid.edges}, "weight")
    tree = set(nx.minimum_spanning_tree(grid).edges)
    for row, column in grid.nodes:
        walls[2 * row + 1, 2 * column + 1] = False
    for edge in grid.edges:
        if edge in tree or rng.random() < 0.25:
            (row, column), (to_row, to_column) = edge
            walls[row + to_row + 1, column + to_column + 1] = False
    return walls


BUILDERS: dict[str, Callable[[np.random.Generator, int, int], Walls]] = {
    "hallways": hallways,
    "rooms": rooms,
    "maze": maze,
}


def random_patrol(rng: np.random.Generator) -> PatrolSettings:
    """A patrol that nobody has tuned anything for.

    Parameters
    ----------
    rng : numpy.random.Generator
        Of the map, the starts, the goals, the deadline and what a step costs.

    Returns
    -------
    PatrolSettings
        Two experts on a map of 6 to 9 cells a side, or, one time in twenty, three on 4 by 4; one to six joint starts,
        each at least three steps from the goals. Whether experts can pass in time is for the caller to find out.
    """
    n_experts = 3 if rng.random() < 0.05 else 2
    while True:
        height, width = (6, 6) if n_experts == 3 else (int(side) for side in rng.integers(6, 9, size=2))
        # Three experts need a small map: its edge is the outer wall, and no maze fits in.
        builder = str(rng.choice(list(BUILDERS)[: -1 if n_experts == 3 else None]))
        walls = BUILDERS[builder](rng, height, width)
        settings = _with_tasks(rng, walls[1:-1, 1:-1] if n_experts == 3 else walls, n_experts)
        if settings is not None:
            return settings


def _with_tasks(rng: np.random.Generator, walls: Walls, n_experts: int) -> PatrolSettings | None:
    """Goals and starts on a map; None where its free cells are few, not connected, or too near to each other."""
    free = [(int(row), int(column)) for row, column in np.argwhere(~walls)]
    ways = nx.grid_2d_graph(*walls.shape).subgraph(free)
    if len(free) < 4 * n_experts or not nx.is_connected(ways):
        return None
    goals = [free[k] for k in rng.permutation(len(free))[:n_experts]]
    distances = [nx.single_source_shortest_path_length(ways, goal) for goal in goals]
    starts = _draw_starts(rng, free, distances, int(rng.integers(1, 7)))
    if not starts:
        return None
    longest = max(distance[cell] for start in starts for cell, distance in zip(start, distances, strict=True))
    deadline = longest + int(rng.integers(3, 7))
    return PatrolSettings(
        map="\n".join("".join("#" if wall else "." for wall in row) for row in walls),
        starts=tuple(starts),
        goals=tuple(goals),
        horizon=deadline + int(rng.integers(2, 10)),
        deadline=deadline,
        step_cost=float(rng.choice(STEP_COSTS)),
    )


def _draw_starts(
    rng: np.random.Generator,
    free: list[tuple[int, int]],
    distances: list[dict[tuple[int, int], int]],
    count: int,
) -> list[tuple[tuple[int, int], ...]]:
    """Up to ``count`` different joint starts, every expert at least three steps from its goal."""
    starts = list[tuple[tuple[int, int], ...]]()
    for _ in range(TRIES):
        start = tuple(free[k] for k in rng.permutation(len(free))[: len(distances)])
        far = all(distance[cell] >= 3 for cell, distance in zip(start, distances, strict=True))
        if far and start not in starts:
            starts.append(start)
        if len(starts) == count:
            break
    return starts
