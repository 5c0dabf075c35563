"""What is drawn of a game, of what a learner has learned, and of who hears whom."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from mabirds_msgs.msg import Constraints
from nav_msgs.msg import OccupancyGrid
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mabirds_bringup.draw import messages
from mabirds_bringup.draw.colours import EDGES, LEARNER, TEXT, colour_of
from mabirds_bringup.watch.edges import EdgeState
from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.consensus.weights import Edge
from mabirds_core.games.scene import Raster, Scene
from mabirds_msgs_py.constraints_conversion import read_constraints

FAINTEST = 0.25
"""Alpha of a constraint of the least confidence, so that it can be seen."""


class Grids(NamedTuple):
    """Of one learner, a grid for each expert.

    Attributes
    ----------
    costs : list[OccupancyGrid]
        Learned costs as shares of the largest.
    keepout : list[OccupancyGrid]
        Where an expert may not be, by what was learned.
    """

    costs: list[OccupancyGrid]
    keepout: list[OccupancyGrid]


def grids(
    header: Header, scene: Scene, omega: Vector, threshold: float, constraints: Constraints | None = None
) -> Grids:
    """Draw learned costs and constraints.

    Parameters
    ----------
    header : Header
        With frame and stamp.
    scene : Scene
        Of the game.
    omega : Vector
        Cost weights, shape (K,).
    threshold : float
        Cost from which on a place is forbidden, as long as there are no constraints.
    constraints : Constraints, optional
        As the learner has published them.

    Returns
    -------
    Grids
        For each expert.
    """
    costs, raster = scene.costs(omega), scene.raster
    forbidden = costs > threshold if constraints is None else forbidden_cells(scene, constraints)
    most = float(costs.max())
    return Grids(
        [messages.costs_grid(header, raster, of_expert, most) for of_expert in costs],
        [messages.keepout_mask(header, raster, of_expert) for of_expert in forbidden],
    )


def forbidden_cells(scene: Scene, constraints: Constraints) -> Mask:
    """The cells in which learned constraints lie, shape (N_E, rows, columns)."""
    raster, spots = scene.raster, scene.spots()
    cells = np.zeros((len(scene.goals), raster.rows, raster.columns), dtype=np.bool_)
    for name in filter(spots.__contains__, constraints.names):
        expert, x, y = spots[name]
        cells[expert, _row(y, raster.resolution, raster.rows), _row(x, raster.resolution, raster.columns)] = True
    return cells


def _row(place: float, resolution: float, count: int) -> int:
    return min(count - 1, max(0, int(place / resolution)))


def constraint_markers(header: Header, scene: Scene, constraints: Constraints) -> MarkerArray:
    """A cube for each constraint that is a place, the surer the denser; a line of words for each other one."""
    spots, side = scene.spots(), marker_size(scene.raster)
    drawn, others = [], 0
    for name, confidence in read_constraints(constraints).items():
        if name in spots:
            expert, x, y = spots[name]
            shift = 0.12 * side * (expert - (len(scene.goals) - 1) / 2)  # so that those of all experts can be seen
            place, size = (x + shift, y + shift, 0.05), (0.6 * side, 0.6 * side, 0.1)
            alpha = FAINTEST + (1 - FAINTEST) * (confidence - constraints.level) / max(1e-9, 1 - constraints.level)
            group = f"constraints of expert {expert + 1}"
            drawn.append(messages.marker(header, group, Marker.CUBE, place, size, colour_of(expert), alpha))
        else:
            others += 1
            place = (scene.raster.columns * scene.raster.resolution / 2, -0.7 * others * side, 0.0)
            words = f"{name}: {confidence:.3f}"
            drawn.append(messages.label(header, "other constraints", place, words, 0.5 * side, TEXT))
    return MarkerArray(markers=messages.numbered(drawn, header))


def scene_markers(header: Header, scene: Scene) -> MarkerArray:
    """Each expert where it begins, and its goal, with their names."""
    size, drawn = 0.5 * marker_size(scene.raster), []
    for expert, (start, goal) in enumerate(zip(scene.starts, scene.goals, strict=True)):
        colour, name = colour_of(expert), f"expert {expert + 1}"
        below = (goal[0], goal[1] - 1.6 * size, size)
        drawn += [
            messages.marker(header, "experts", Marker.SPHERE, (*start, size / 2), (size,) * 3, colour),
            messages.label(header, "names", (start[0], start[1] + 0.8 * size, size), name, 0.7 * size, colour),
            messages.marker(
                header, "goals", Marker.CYLINDER, (*goal, 0.0), (1.4 * size, 1.4 * size, 0.05), colour, 0.6
            ),
            messages.label(header, "names", below, f"goal {expert + 1}", 0.7 * size, colour),
        ]
    return MarkerArray(markers=messages.numbered(drawn, header))


def network_markers(
    header: Header, learners: tuple[str, ...], states: Mapping[Edge, EdgeState], raster: Raster
) -> MarkerArray:
    """Learners on a circle to the right of the map, an arrow for each edge in the colour of its state."""
    places, size = circle(len(learners), raster), 0.5 * marker_size(raster)
    drawn = [
        messages.marker(header, "learners", Marker.SPHERE, (*place, 0.0), (size,) * 3, LEARNER) for place in places
    ]
    drawn += [
        messages.label(header, "names", (place[0], place[1] + 0.8 * size, size), name, 0.8 * size, TEXT)
        for name, place in zip(learners, places, strict=True)
    ]
    for (sender, receiver), state in states.items():
        ends = arrow_ends(places[sender], places[receiver], size)
        drawn.append(messages.arrow(header, state, ends, 0.15 * size, EDGES[state]))
    return MarkerArray(markers=messages.numbered(drawn, header))


def circle(count: int, raster: Raster) -> Array:
    """Places of learners, shape (count, 2) [m]."""
    height = raster.rows * raster.resolution
    radius = 0.35 * height
    angles = np.pi / 2 - 2 * np.pi * np.arange(count) / count
    middle = (raster.columns * raster.resolution + 0.7 * height, height / 2)
    return np.asarray(middle + radius * np.column_stack([np.cos(angles), np.sin(angles)]))


def arrow_ends(begin: Array, end: Array, size: float) -> Array:
    """From the rim of one sphere to that of the other, a little to the right: there is room for the way back."""
    along = (end - begin) / np.linalg.norm(end - begin)
    aside = 0.25 * size * np.array([along[1], -along[0]])
    return np.stack([begin + 0.6 * size * along, end - 0.6 * size * along]) + aside


def marker_size(raster: Raster) -> float:
    """What is to be seen beside the whole map [m]: a cell, where cells are large."""
    return max(raster.resolution, 0.06 * max(raster.rows, raster.columns) * raster.resolution)
