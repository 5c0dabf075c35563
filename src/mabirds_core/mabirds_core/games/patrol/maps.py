"""A patrol map on an axis: obstacles, starts, goal, visits, learned constraints and ways."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from mabirds_core.arrays import Array, Mask
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame

MOST_STARTS = 24
"""More starts than these would hide the map."""


def draw_map(
    axis: Axes, game: PatrolGame, expert: int, visits: Array | None = None, learned: Mask | None = None
) -> None:
    """Obstacles grey, starts S, goal G; ``visits`` (n,) blue, ``learned`` (n,) red crosses."""
    shape = (game.height, game.width)
    blue = np.zeros(game.n_cells) if visits is None else np.sqrt(visits)
    axis.imshow(blue.reshape(shape), cmap="Blues", vmin=0, vmax=0.6)
    obstacles = np.ma.masked_where(~game.obstacles, np.ones(game.n_cells)).reshape(shape)
    axis.imshow(obstacles, cmap="Greys", vmin=0, vmax=2.5)
    if learned is not None:
        rows, columns = np.divmod(np.flatnonzero(learned), game.width)
        axis.scatter(columns, rows, marker="x", color="tab:red", s=28)
    for row, column in {start[expert] for start in game.settings.starts[:MOST_STARTS]}:
        axis.annotate("S", (column, row), ha="center", va="center", fontsize=8)
    row, column = game.settings.goals[expert]
    box = {"boxstyle": "round,pad=0.1", "color": "tab:green", "alpha": 0.8}
    axis.annotate("G", (column, row), ha="center", va="center", fontsize=8, color="white", weight="bold", bbox=box)
    axis.set_xticks([])
    axis.set_yticks([])


def draw_ways(axis: Axes, game: PatrolGame, expert: int, demonstrations: Sequence[Trajectories]) -> None:
    """One thin line a demonstration, each shifted a little so that all can be seen."""
    for offset, one in zip(np.linspace(-0.25, 0.25, len(demonstrations)), demonstrations, strict=True):
        rows, columns = np.divmod(game.cells(one.states[0])[expert], game.width)
        axis.plot(columns + offset, rows + offset, color="tab:blue", linewidth=0.8, alpha=0.7)
