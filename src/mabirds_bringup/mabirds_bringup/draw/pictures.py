"""Grids, markers and paths as they were published, drawn to PNG: what RViz shows, without RViz."""

from collections.abc import Iterator, Mapping
from math import ceil
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from nav_msgs.msg import OccupancyGrid, Path
from visualization_msgs.msg import Marker, MarkerArray

from mabirds_bringup.draw import names
from mabirds_bringup.draw.colours import css
from mabirds_core.arrays import Array
from mabirds_core.texts import sanitize

COLUMNS = 4


def picture(drawn: Mapping[str, Any]) -> Figure:
    """A panel for each grid, and for each topic of markers that has no grid beside it; paths and markers on top.

    Parameters
    ----------
    drawn : Mapping[str, Any]
        The newest message of each topic.

    Returns
    -------
    Figure
        Titles are the topics.
    """
    panels = dict(_panels(drawn))
    columns = min(COLUMNS, max(1, len(panels)))
    rows = ceil(len(panels) / columns) or 1
    size = (3.6 * columns, 3.6 * rows)
    figure, axes = plt.subplots(rows, columns, figsize=size, squeeze=False, layout="constrained")
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, (topic, layers) in zip(axes.flat, panels.items(), strict=False):
        axis.set_axis_on()
        _draw_panel(axis, topic, layers)
    return figure


def _panels(drawn: Mapping[str, Any]) -> Iterator[tuple[str, list[tuple[str, Any]]]]:
    """Topics with a panel of their own, and what is drawn in it with its topic, from the bottom up."""
    of_kind = {kind: {t: m for t, m in sorted(drawn.items()) if isinstance(m, kind)} for kind in (OccupancyGrid, Path)}
    for topic, grid in of_kind[OccupancyGrid].items():
        namespace, last = topic.partition("/drawn/")[0], topic.rpartition("/")[2]
        paths = [(t, m) for t, m in of_kind[Path].items() if t.startswith(f"{namespace}/") and t.endswith(f"/{last}")]
        yield topic, [(topic, grid), *paths]
    for topic, message in sorted(drawn.items()):
        if isinstance(message, MarkerArray):
            ground = [(t, grid) for t, grid in of_kind[OccupancyGrid].items() if _beside(t, topic)][:1]
            yield topic, [*ground, (topic, message)]


def _beside(grid: str, markers: str) -> bool:
    return grid.partition("/drawn/")[0] == markers.partition("/drawn/")[0]


def _draw_panel(axis: Axes, topic: str, layers: list[tuple[str, Any]]) -> None:
    for of, layer in layers:
        if isinstance(layer, OccupancyGrid):
            _draw_grid(axis, layer, faint=any(isinstance(other, MarkerArray) for _, other in layers))
        elif isinstance(layer, Path):
            _draw_path(axis, layer, of.rpartition("/")[0].rpartition("/")[2])
        else:
            for each in layer.markers:
                _draw_marker(axis, each)
    axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    axis.set_title(sanitize(topic), fontsize=8)
    _make_square(axis)
    if axis.get_legend_handles_labels()[0]:
        axis.legend(fontsize=7, loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, frameon=False)


def _make_square(axis: Axes) -> None:
    """As wide as high, with room for names at the rim."""
    axis.autoscale_view()
    limits = np.array([axis.get_xlim(), axis.get_ylim()])
    half = 1.15 * np.ptp(limits, axis=1).max() / 2
    (left, right), (bottom, top) = limits.mean(axis=1, keepdims=True) + np.array([-half, half])
    axis.set(xlim=(left, right), ylim=(bottom, top))


def _draw_grid(axis: Axes, grid: OccupancyGrid, *, faint: bool) -> None:
    info = grid.info
    cells = np.array(grid.data, dtype=np.int8).reshape(info.height, info.width)
    left, bottom = info.origin.position.x, info.origin.position.y
    extent = (left, left + info.width * info.resolution, bottom, bottom + info.height * info.resolution)
    axis.imshow(cells, origin="lower", extent=extent, cmap="Greys", vmin=0, vmax=100, alpha=0.35 if faint else 1.0)


def _draw_path(axis: Axes, path: Path, kind: str) -> None:
    """A line from a dot on; ``kind``: imagined or demonstrated."""
    places = np.array([(pose.pose.position.x, pose.pose.position.y) for pose in path.poses]).reshape(-1, 2)
    colour = "tab:blue" if kind == names.DEMONSTRATED else "tab:red"
    axis.plot(*places.T, color=colour, linewidth=1.6, label=sanitize(kind))
    axis.plot(*places[:1].T, "o", color=colour, markersize=5)


def _draw_marker(axis: Axes, marker: Marker) -> None:
    x, y, colour = marker.pose.position.x, marker.pose.position.y, css(marker.color)
    look = {"color": colour, "alpha": marker.color.a}
    if marker.action != Marker.ADD:
        return
    if marker.type == Marker.CUBE:
        corner = (x - marker.scale.x / 2, y - marker.scale.y / 2)
        axis.add_patch(Rectangle(corner, marker.scale.x, marker.scale.y, **look))
    elif marker.type in {Marker.SPHERE, Marker.CYLINDER}:
        axis.add_patch(Circle((x, y), marker.scale.x / 2, **look))
    elif marker.type == Marker.TEXT_VIEW_FACING:
        axis.text(x, y, sanitize(marker.text), ha="center", fontsize=7, **look)
        axis.update_datalim([(x, y)])
    elif marker.type == Marker.ARROW:
        _draw_arrow(axis, np.array([(point.x, point.y) for point in marker.points]), look)


def _draw_arrow(axis: Axes, ends: Array, look: dict[str, Any]) -> None:
    style = {"arrowstyle": "-|>", "linewidth": 1.6, **look}
    axis.annotate("", xy=tuple(ends[1]), xytext=tuple(ends[0]), arrowprops=style)
    axis.update_datalim(ends)
