"""What a process must set before it uses ROS from pip wheels."""

import os
import sys
from collections.abc import MutableMapping
from pathlib import Path


def prepare_environment(environment: MutableMapping[str, str] = os.environ) -> None:
    """Fill in what pip wheels of ROS leave open; values that the user has set stay.

    AMENT_PREFIX_PATH: the wheels install their index under the interpreter's prefix but do not say so.
    FASTDDS_BUILTIN_TRANSPORTS: shared-memory files of killed processes slow every later discovery down.
    HOME: ROS's logging needs a home directory to write to.
    """
    if (Path(sys.prefix) / "share" / "ament_index").is_dir():
        environment.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    environment.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    environment.setdefault("HOME", str(Path.cwd()))
