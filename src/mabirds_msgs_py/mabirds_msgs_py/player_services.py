"""The services of a player by name: rosbag2's own types where rosbag2_interfaces is installed, else equal ones."""

import importlib
from functools import cache
from typing import Any

OWN_PACKAGE, ROSBAG2_PACKAGE = "mabirds_msgs", "rosbag2_interfaces"

PLAYER_SERVICES = {
    "pause": "Pause",
    "resume": "Resume",
    "toggle_paused": "TogglePaused",
    "is_paused": "IsPaused",
    "get_rate": "GetRate",
    "set_rate": "SetRate",
    "play": "Play",
    "play_next": "PlayNext",
    "burst": "Burst",
    "seek": "Seek",
    "stop": "Stop",
}
"""rosbag2's names of services, below the player's own name, and of their types."""

RESEND = "resend"
"""A service of this project's alone: a demonstration once more."""

STATUS = "player_status"
"""Where a player says how it stands, below its own name."""


@cache
def service_package() -> str:
    """The package whose types players here serve."""
    try:
        importlib.import_module(f"{ROSBAG2_PACKAGE}.srv")
    except ImportError:
        return OWN_PACKAGE
    return ROSBAG2_PACKAGE


def service_type(name: str, package: str | None = None) -> Any:
    """The type of a player's service.

    Parameters
    ----------
    name : str
        One of PLAYER_SERVICES.
    package : str, optional
        Where it is from; default: that of players here.

    Returns
    -------
    Any
        The class.
    """
    module = importlib.import_module(f"{package or service_package()}.srv")
    return getattr(module, PLAYER_SERVICES[name])
