"""Arenas with drones: obstacles, goal regions, starts, rollouts, and what places and distances are learned to cost."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure, FigureBase
from matplotlib.image import AxesImage
from matplotlib.patches import Circle, Polygon, Rectangle
from matplotlib.patheffects import Normal, Stroke

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.judge import RolloutJudge
from mabirds_core.games.drones.learned_costs import distance_costs, place_costs
from mabirds_core.games.drones.regions import Obstacle
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.whole_game import Learned

COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple", "tab:brown")
"""Colours of the drones, in turn."""

FIELD = "viridis"
"""Perceptually uniform: equal differences of cost look equal."""

RESOLUTION = 0.05
"""Metres between two places whose costs are drawn."""

RIM = 90
"""Corners with which rims of obstacles are drawn."""

DISTANCES = np.linspace(0.0, 1.5, 151)


def colour_of(drone: int) -> str:
    """The colour of a drone, its start, goal region and trajectories."""
    return COLOURS[drone % len(COLOURS)]


def draw_arena(axis: Axes, game: DroneGame, drones: Sequence[int] | None = None, *, filled: bool = True) -> None:
    """Draw obstacles, around each the line that drones' middles may not cross; starts as squares, goals as circles.

    Parameters
    ----------
    axis : Axes
        Of the arena.
    game : DroneGame
        With obstacles and tasks.
    drones : Sequence[int], optional
        Whose starts and goal regions are drawn; None: of all.
    filled : bool, optional
        Obstacles in grey, not as outlines.
    """
    settings = game.settings
    for barrier in settings.barriers:
        axis.add_patch(_patch(barrier, 0.0, fc="0.6" if filled else "none", ec="0.1", lw=1.2))
        axis.add_patch(_patch(barrier, settings.drone_radius, fc="none", ec="0.1", lw=0.7, ls=":"))
    for drone in range(game.n_experts) if drones is None else drones:
        task, colour = settings.drones[drone], colour_of(drone)
        low, high = task.start_corners
        axis.add_patch(Rectangle(tuple(low), *(high - low), fc="none", ec=colour, lw=1.3))
        for end in (task.goal_region.centre, task.goal_region.until or task.goal_region.centre):
            axis.add_patch(Circle(end, task.goal_region.radius, fc="none", ec=colour, lw=1.8))
        if task.goal_region.until is not None:
            axis.plot(*np.transpose([task.goal_region.centre, task.goal_region.until]), color=colour, lw=1.8)
    width, depth = settings.arena
    axis.set(xlim=(0, width), ylim=(0, depth), aspect="equal", xticks=[], yticks=[])


def _patch(barrier: Obstacle, margin: float, **style: Any) -> Circle | Polygon:
    """A barrier that is widened by a margin."""
    if barrier.until is None:
        return Circle(barrier.centre, barrier.radius + margin, **style)
    return Polygon(barrier.outline(margin, RIM), **style)


def draw_trajectories(axis: Axes, places: Array, drones: Sequence[int], *, cased: bool = False) -> None:
    """Draw trajectories, a line each.

    Parameters
    ----------
    axis : Axes
        Of the arena.
    places : Array
        Shape (m, T + 1, N_E, 2) [m].
    drones : Sequence[int]
        Whose trajectories are drawn.
    cased : bool, optional
        With a white rim, for a dark ground.
    """
    rim = [Stroke(linewidth=1.3, foreground="white", alpha=0.7), Normal()] if cased else None
    for drone in drones:
        for trajectory in places[:, :, drone]:
            axis.plot(*trajectory.T, color=colour_of(drone), linewidth=0.7, alpha=0.9, path_effects=rim)


def cost_field(game: DroneGame, omega: Vector, drone: int) -> Array:
    """Learned costs of places ``RESOLUTION`` apart.

    Parameters
    ----------
    game : DroneGame
        With the arena.
    omega : Vector
        Cost weights, shape (K,).
    drone : int
        Index.

    Returns
    -------
    Array
        y by x.
    """
    x, y = (np.arange(RESOLUTION / 2, side, RESOLUTION) for side in game.settings.arena)
    return place_costs(game, omega, drone, np.stack(np.meshgrid(x, y), axis=-1))


def draw_cost(axis: Axes, game: DroneGame, field: Array, limits: tuple[float, float] | None = None) -> AxesImage:
    """Draw what every place costs.

    Parameters
    ----------
    axis : Axes
        Of the arena.
    game : DroneGame
        With the arena.
    field : Array
        Of ``cost_field``.
    limits : tuple[float, float], optional
        Least and largest cost of the colours; default: those of the drawing.

    Returns
    -------
    AxesImage
        For a colour bar.
    """
    low, high = limits or (None, None)
    width, depth = game.settings.arena
    return axis.imshow(field, cmap=FIELD, origin="lower", extent=(0.0, width, 0.0, depth), vmin=low, vmax=high)


def way_cost(game: DroneGame, omega: Vector, drone: int, places: Array) -> float:
    """Mean learned cost of where a drone is under way, which costs of other places are told against.

    Parameters
    ----------
    game : DroneGame
        With the goal regions.
    omega : Vector
        Cost weights, shape (K,).
    drone : int
        Index.
    places : Array
        Of flights, shape (m, T + 1, N_E, 2) [m].

    Returns
    -------
    float
        In units of reward; 0 where it is never under way.
    """
    flown = places[..., drone, :][~game.dynamics.arrived(places)[..., drone]]
    return float(place_costs(game, omega, drone, flown).mean()) if len(flown) else 0.0


class LearnedCosts(NamedTuple):
    """What was learned, and what comes of it.

    Attributes
    ----------
    omega : Vector
        Cost weights, shape (K,).
    places : Array
        Of rollouts of the policy, shape (m, T + 1, N_E, 2) [m].
    """

    omega: Vector
    places: Array


def draw_costs(figure: FigureBase, game: DroneGame, learned: dict[str, LearnedCosts]) -> None:
    """Draw by how much places are learned to cost more than the ways that are flown, with one scale for all panels.

    Parameters
    ----------
    figure : FigureBase
        In which the panels are.
    game : DroneGame
        With the arena.
    learned : dict[str, LearnedCosts]
        By name, a column each; a row per drone.
    """
    axes = figure.subplots(game.n_experts, len(learned), squeeze=False)
    fields = [
        [cost_field(game, omega, i) - way_cost(game, omega, i, places) for i in range(game.n_experts)]
        for omega, places in learned.values()
    ]
    limits = float(np.min(fields)), float(np.max(fields))
    for column, of_drones, (name, (_, places)) in zip(axes.T, fields, learned.items(), strict=True):
        for drone, axis in enumerate(column):
            image = draw_cost(axis, game, of_drones[drone], limits)
            draw_arena(axis, game, [drone], filled=False)
            draw_trajectories(axis, places, [drone], cased=True)
            axis.set_title(f"{name}, drone {drone + 1}", fontsize=8)
    figure.colorbar(image, ax=axes, label="learned cost of a place, above the drone's own ways [reward]", shrink=0.9)


def draw_distance_costs(axis: Axes, game: DroneGame, omegas: dict[str, Vector]) -> None:
    """Draw what drones' distances are learned to cost; the least distance dashed.

    Parameters
    ----------
    axis : Axes
        Of the distances.
    game : DroneGame
        With the pairs.
    omegas : dict[str, Vector]
        By name; a line for each and pair.
    """
    for name, omega in omegas.items():
        for pair, (first, second) in enumerate(game.pairs):
            label = name if len(game.pairs) == 1 else f"{name}, drones {first + 1} and {second + 1}"
            axis.plot(DISTANCES, distance_costs(game, omega, pair, DISTANCES), label=label, linewidth=1.2)
    axis.axvline(game.settings.least_distance, color="0.1", linestyle="--", linewidth=0.9)
    axis.set(xlabel="distance of the drones [m]; dashed: least allowed", ylabel="learned cost of it [reward]")
    axis.legend(fontsize=7, loc="lower left", bbox_to_anchor=(0.0, 1.01), borderaxespad=0.0)


SHOWN_ROLLOUTS = 15
SHOWN_DEMONSTRATIONS = 40
LABEL_BOX = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85}


def demonstrations_figure(game: DroneGame, demonstrations: Trajectories) -> Figure:
    """As Figure 4a of the paper: the arena, and the first demonstrations of all drones.

    Parameters
    ----------
    game : DroneGame
        With the arena.
    demonstrations : Trajectories
        The first SHOWN_DEMONSTRATIONS are shown.

    Returns
    -------
    Figure
        One panel.
    """
    shown = demonstrations.states[:SHOWN_DEMONSTRATIONS]
    figure, axis = plt.subplots(figsize=(5, 5.3), layout="constrained")
    draw_arena(axis, game)
    draw_trajectories(axis, game.positions(shown), range(game.n_experts))
    for drone, task in enumerate(game.settings.drones):
        for name, place in (("start", task.start), ("goal", task.goal_region.centre)):
            axis.annotate(f"{name} {drone + 1}", place, ha="center", va="center", fontsize=8, bbox=LABEL_BOX)
    width, depth = game.settings.arena
    axis.set_title(f"{len(shown)} demonstrations, arena {width:g} m x {depth:g} m", fontsize=9)
    return figure


def arena_figure(game: DroneGame, judge: RolloutJudge, learned: Mapping[str, Learned], seed: int) -> Figure:
    """Draw what learners or methods ended with.

    Parameters
    ----------
    game : DroneGame
        With the arena.
    judge : RolloutJudge
        Who rolls out.
    learned : Mapping[str, Learned]
        By name.
    seed : int
        Of the rollouts.

    Returns
    -------
    Figure
        As of ``costs_figure``.
    """
    costs = {
        name: LearnedCosts(omega, game.positions(judge.rollouts(policy, seed, SHOWN_ROLLOUTS).states))
        for name, (policy, omega, _) in learned.items()
    }
    return costs_figure(game, alike(costs))


def alike(learned: dict[str, LearnedCosts]) -> dict[str, LearnedCosts]:
    """Those whose cost weights are equal under one name: the first, and how many more.

    Parameters
    ----------
    learned : dict[str, LearnedCosts]
        By name.

    Returns
    -------
    dict[str, LearnedCosts]
        With other names where some agree.
    """
    groups = dict[bytes, list[str]]()
    for name, costs in learned.items():
        groups.setdefault(costs.omega.tobytes(), []).append(name)
    names = {f"{name} + {len(more)} alike" if more else name: name for name, *more in groups.values()}
    return {title: learned[name] for title, name in names.items()}


def costs_figure(game: DroneGame, learned: dict[str, LearnedCosts]) -> Figure:
    """Draw learned costs of each drone's places, with rollouts, and of the drones' distances.

    Parameters
    ----------
    game : DroneGame
        With the arena.
    learned : dict[str, LearnedCosts]
        By name.

    Returns
    -------
    Figure
        A panel per name and drone, and one of the distances.
    """
    width = 2.3 * len(learned) + 1.0
    figure = plt.figure(figsize=(width + 3.6, 2.3 * game.n_experts + 0.5), layout="constrained")
    arenas, distances = figure.subfigures(1, 2, squeeze=False, width_ratios=(width, 3.6))[0]
    draw_costs(arenas, game, learned)
    draw_distance_costs(distances.subplots(), game, {name: costs.omega for name, costs in learned.items()})
    return figure
