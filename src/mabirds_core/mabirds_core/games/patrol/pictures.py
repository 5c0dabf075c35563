"""Patrol maps: obstacles, starts, goals, visits, learned constraints and ways."""

from collections.abc import Mapping
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.cost_shapes import by_distance
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.visits import visits
from mabirds_core.games.whole_game import Learned

MAX_DEMONSTRATIONS = 12
"""More lines than these could not be told apart."""

MAX_STARTS = 24
"""More starts than these would hide the map."""


def draw_map(
    axis: Axes, game: PatrolGame, expert: int, visits: Array | None = None, learned: Mask | None = None
) -> None:
    """Draw obstacles grey, starts S, goal G.

    Parameters
    ----------
    axis : Axes
        Of one expert's map.
    game : PatrolGame
        With the map.
    expert : int
        Whose starts and goal.
    visits : Array, optional
        Blue, shape (n,).
    learned : Mask, optional
        Cells with red crosses, shape (n,).
    """
    shape = (game.height, game.width)
    blue = np.zeros(game.n_cells) if visits is None else np.sqrt(visits)
    axis.imshow(blue.reshape(shape), cmap="Blues", vmin=0, vmax=0.6)
    obstacles = np.ma.masked_where(~game.obstacles, np.ones(game.n_cells)).reshape(shape)
    axis.imshow(obstacles, cmap="Greys", vmin=0, vmax=2.5)
    if learned is not None:
        rows, columns = np.divmod(np.flatnonzero(learned), game.width)
        axis.scatter(columns, rows, marker="x", color="tab:red", s=28)
    for row, column in {start[expert] for start in game.settings.starts[:MAX_STARTS]}:
        axis.annotate("S", (column, row), ha="center", va="center", fontsize=8)
    box = {"boxstyle": "round,pad=0.1", "color": "tab:green", "alpha": 0.8}
    for row, column in game.settings.goal_cells[expert]:
        axis.annotate("G", (column, row), ha="center", va="center", fontsize=8, color="white", weight="bold", bbox=box)
    axis.set_xticks([])
    axis.set_yticks([])


def draw_paths(axis: Axes, game: PatrolGame, expert: int, demonstrations: Trajectories) -> None:
    """Draw one thin line per demonstration, each shifted a little so that all can be seen.

    Parameters
    ----------
    axis : Axes
        Of one expert's map.
    game : PatrolGame
        With the map.
    expert : int
        Whose paths.
    demonstrations : Trajectories
        A line each.
    """
    offsets = np.linspace(-0.25, 0.25, len(demonstrations.states))
    for offset, states in zip(offsets, demonstrations.states, strict=True):
        rows, columns = np.divmod(game.cells(states)[expert], game.width)
        axis.plot(columns + offset, rows + offset, color="tab:blue", linewidth=0.8, alpha=0.7)


def draw_costs_by_distance(axis: Axes, game: PatrolGame, omega: Vector) -> None:
    """Draw what joint states cost by the distance of the nearest two experts: the mean, and from least to most.

    Parameters
    ----------
    axis : Axes
        To draw on.
    game : PatrolGame
        Whose cost model tells what joint states cost.
    omega : Vector
        Of a network.
    """
    costs: Any = costs_of(game)
    apart, mean, least, most = by_distance(game, costs.of_states(omega))
    axis.fill_between(apart, least, most, color="tab:blue", alpha=0.2)
    axis.plot(apart, mean, marker=".", color="tab:blue")
    axis.set_ylim(bottom=0)
    axis.set_xlabel("distance of the nearest two [cells]", fontsize=7)
    axis.set_ylabel("learned cost, mean and range [nats]", fontsize=7)
    axis.tick_params(labelsize=7)


def demonstrations_figure(game: PatrolGame, demonstrations: Trajectories) -> Figure:
    """As Figure 2a of the paper: a map of each expert with starts, goal, and the first demonstrations.

    Parameters
    ----------
    game : PatrolGame
        With the map.
    demonstrations : Trajectories
        The first MAX_DEMONSTRATIONS are shown.

    Returns
    -------
    Figure
        One row.
    """
    shown = Trajectories(*(steps[:MAX_DEMONSTRATIONS] for steps in demonstrations))
    size = (3 * game.n_experts, 3.2)
    figure, axes = plt.subplots(1, game.n_experts, figsize=size, squeeze=False, layout="constrained")
    for expert, axis in enumerate(axes[0]):
        draw_map(axis, game, expert)
        draw_paths(axis, game, expert, shown)
        axis.set_title(f"expert {expert + 1}", fontsize=9)
    figure.suptitle(f"{len(shown.states)} demonstrations; S starts, G goals{_of_obstacles(game)}", fontsize=9)
    return figure


def map_figure(game: PatrolGame, learned: Mapping[str, Learned]) -> Figure:
    """Draw visitation in blue, learned constraints as red crosses, obstacles in grey; of networks, costs by distance.

    Parameters
    ----------
    game : PatrolGame
        With the map.
    learned : Mapping[str, Learned]
        By name.

    Returns
    -------
    Figure
        A column per name, a row per expert, and one for what a network has learned.
    """
    rows = game.n_experts + (hasattr(costs_of(game), "of_states") and game.n_experts > 1)
    size = (2.6 * len(learned) + 0.8, 2.8 * rows)
    figure, axes = plt.subplots(rows, len(learned), figsize=size, squeeze=False, layout="constrained")
    for column, (name, (policy, omega, constrained)) in zip(axes.T, learned.items(), strict=True):
        visited = visits(game, policy)
        for expert, axis in enumerate(column[: game.n_experts]):
            cells = slice(expert * game.n_cells, (expert + 1) * game.n_cells)
            draw_map(axis, game, expert, visited[expert], constrained[cells])
            axis.set_title(f"{name}: expert {expert + 1}", fontsize=9)
        joint = _joint_constraints(game, constrained) + _named_costs(game, omega)
        column[game.n_experts - 1].set_xlabel(joint, fontsize=7)
        for axis in column[game.n_experts :]:
            draw_costs_by_distance(axis, game, omega)
    truth = "\nnobody knows the truth" if game.true_constraints is None else ";\ntrue obstacles (grey)"
    figure.suptitle(f"policy (blue), constraints (red) as learned{truth}; S starts, G goals", fontsize=10)
    return figure


def _of_obstacles(game: PatrolGame) -> str:
    return ", grey obstacles" if game.obstacles.any() else ""


def _joint_constraints(game: PatrolGame, learned: Mask) -> str:
    first = game.n_experts * game.n_cells
    names = [name for name, is_learned in zip(("sharing", "swapping"), learned[first:], strict=False) if is_learned]
    return "joint constraints: " + (", ".join(names) or "none")


def _named_costs(game: PatrolGame, omega: Vector) -> str:
    if not costs_of(game).linear:
        return ""
    weights = omega[game.n_experts * game.n_cells + 2 :]
    return "".join(f"\n{name} costs {-weight:.2f}" for name, weight in zip(game.settings.costs, weights, strict=True))
