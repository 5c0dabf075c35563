"""A grid of costs as a few lines of text."""

from typing import Any

import numpy as np

from mabirds_core.arrays import Array

SHADES = "·░▒▓█"

MOST_ROWS, MOST_COLUMNS = 12, 24


def cost_map(grid: Any) -> str:
    """A grid as published on */drawn/costs/*: the top line is the largest y, the darkest cell the costliest.

    Parameters
    ----------
    grid : Any
        An OccupancyGrid.

    Returns
    -------
    str
        At most MOST_ROWS lines.
    """
    cells = np.array(grid.data, dtype=np.float64).reshape(grid.info.height, grid.info.width)
    coarse = _coarser(_coarser(cells, MOST_ROWS).T, MOST_COLUMNS).T
    steps = np.ceil(np.clip(coarse, 0, 100) / 100 * (len(SHADES) - 1)).astype(int)
    return "\n".join("".join(SHADES[step] for step in row) for row in steps[::-1])


def _coarser(cells: Array, most: int) -> Array:
    """No more than ``most`` rows, each the largest of those that it stands for."""
    edges = np.linspace(0, len(cells), min(most, len(cells)), endpoint=False).astype(int)
    return np.asarray(np.maximum.reduceat(cells, edges, axis=0))
