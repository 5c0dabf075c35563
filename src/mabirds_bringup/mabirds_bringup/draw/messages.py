"""Arrays to the messages that RViz, Foxglove and Nav2 draw and use."""

from array import array
from collections.abc import Sequence

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import Point, Pose, PoseStamped, Vector3
from nav_msgs.msg import MapMetaData, OccupancyGrid, Path
from std_msgs.msg import Header
from visualization_msgs.msg import Marker

from mabirds_bringup.draw.colours import rgba
from mabirds_core.arrays import Array, Mask
from mabirds_core.games.scene import Raster

OCCUPIED = 100
"""The largest value of a cell of an OccupancyGrid; a keepout mask of Nav2 forbids it."""


def grid(header: Header, raster: Raster, values: Array) -> OccupancyGrid:
    """A grid of whole numbers from 0 to 100; row 0 is at the bottom, as in an OccupancyGrid.

    Parameters
    ----------
    header : Header
        With frame and stamp.
    raster : Raster
        Where cells are.
    values : Array
        Shape (rows, columns), of [0, 1].

    Returns
    -------
    OccupancyGrid
        Its origin is that of the frame.
    """
    info = MapMetaData(
        map_load_time=header.stamp, resolution=raster.resolution, width=raster.columns, height=raster.rows
    )
    info.origin.orientation.w = 1.0
    cells = np.rint(OCCUPIED * np.clip(values, 0.0, 1.0)).astype(np.int8)
    return OccupancyGrid(header=header, info=info, data=array("b", cells.tobytes()))


def costs_grid(header: Header, raster: Raster, costs: Array, most: float) -> OccupancyGrid:
    """Learned costs as shares of the largest one, ``most``; what costs nothing or less is 0."""
    return grid(header, raster, costs / most if most > 0 else np.zeros_like(costs))


def keepout_mask(header: Header, raster: Raster, forbidden: Mask) -> OccupancyGrid:
    """What Nav2's keepout filter takes: 100 where nobody may be, 0 elsewhere."""
    return grid(header, raster, forbidden.astype(np.float64))


def path(header: Header, places: Array) -> Path:
    """A path through places (T + 1, 2) [m], a step a second."""
    poses = []
    for step, (x, y) in enumerate(places):
        stamp = Time(sec=header.stamp.sec + step, nanosec=header.stamp.nanosec)
        pose = PoseStamped(header=Header(stamp=stamp, frame_id=header.frame_id))
        pose.pose.position.x, pose.pose.position.y, pose.pose.orientation.w = float(x), float(y), 1.0
        poses.append(pose)
    return Path(header=header, poses=poses)


def marker(
    header: Header, group: str, kind: int, place: Sequence[float], size: Sequence[float], colour: str, alpha: float = 1
) -> Marker:
    """A marker at a place.

    Parameters
    ----------
    header : Header
        With frame and stamp.
    group : str
        Its namespace.
    kind : int
        Such as Marker.CUBE.
    place : Sequence[float]
        x, y, z [m].
    size : Sequence[float]
        Along x, y and z [m].
    colour : str
        Such as "#d62728".
    alpha : float, optional
        0: not to be seen.

    Returns
    -------
    Marker
        Without a number, which ``numbered`` gives.
    """
    result = Marker(header=header, ns=group, type=kind, action=Marker.ADD, color=rgba(colour, alpha))
    x, y, z = map(float, place)
    result.pose = Pose(position=Point(x=x, y=y, z=z))
    result.pose.orientation.w = 1.0
    width, depth, height = map(float, size)
    result.scale = Vector3(x=width, y=depth, z=height)
    return result


def label(header: Header, group: str, place: Sequence[float], text: str, height: float, colour: str) -> Marker:
    """Words that face whoever looks; ``height`` of a letter [m]."""
    result = marker(header, group, Marker.TEXT_VIEW_FACING, place, (0.0, 0.0, height), colour)
    result.text = text
    return result


def arrow(header: Header, group: str, ends: Array, width: float, colour: str) -> Marker:
    """An arrow from ``ends[0]`` to ``ends[1]``, shape (2, 2) [m]."""
    result = marker(header, group, Marker.ARROW, (0, 0, 0), (width, 2.5 * width, 3 * width), colour)
    result.points = [Point(x=float(x), y=float(y)) for x, y in ends]
    return result


def numbered(markers: Sequence[Marker], header: Header) -> list[Marker]:
    """A number for each; before them one that takes away what was drawn before."""
    clear = Marker(header=header, action=Marker.DELETEALL)
    for number, each in enumerate(markers):
        each.id = number
    return [clear, *markers]
