"""The part of the plane that belongs to the game: told by its corners, or by a map of map_server."""

from pathlib import Path
from typing import Any

import numpy as np
import yaml
from PIL import Image

from mabirds_bringup.importing.rules import AreaRule
from mabirds_core.arrays import Array
from mabirds_core.errors import ExperimentError
from mabirds_core.yaml_files import read_yaml


def corners_of(area: AreaRule) -> tuple[Array, Array]:
    """Lower left and upper right corner.

    Parameters
    ----------
    area : AreaRule
        Of the rules.

    Returns
    -------
    tuple[Array, Array]
        Shape (2,) each [m].

    Raises
    ------
    ExperimentError
        The map cannot be read, or is rotated.
    """
    if area.corners is not None:
        return np.array(area.corners[0]), np.array(area.corners[1])
    if area.map is None:
        raise ExperimentError("area: expected corners or a map")
    return _of_map(area.map)


def _of_map(file: Path) -> tuple[Array, Array]:
    try:
        content: dict[str, Any] = read_yaml(file)
        with Image.open(file.parent / content["image"]) as image:
            size = np.array(image.size)
        resolution, origin = float(content["resolution"]), np.array(content["origin"], dtype=np.float64)
        low, yaw = origin[:2], float(origin[2])
    except (OSError, ValueError, KeyError, TypeError, IndexError, yaml.YAMLError) as error:
        raise ExperimentError(
            f"{file}: is no map of map_server ({error!r}); expected image, resolution and origin [x, y, yaw]"
        ) from None
    if yaw:
        raise ExperimentError(f"{file}: origin has yaw {yaw:g}, expected 0; give corners instead")
    return low, low + size * resolution
