"""What a process must set before it uses ROS from pip wheels, and how it talks to other hosts."""

import os
import sys
from collections.abc import MutableMapping
from contextlib import suppress
from importlib import import_module
from pathlib import Path
from typing import Any

FASTDDS_PROFILE = Path(__file__).with_name("fastdds_profile.xml")
"""How Fast DDS sends; docs/hosts.md explains it."""

ONE_HOST_PROFILE = Path(__file__).with_name("fastdds_one_host_profile.xml")
"""The same with datagrams as large as they may be."""

LOOPBACK_PROFILE = Path(__file__).with_name("fastdds_loopback_profile.xml")
"""The same again, but to and from this host only."""

GENERATOR = "rosidl_generator_py.generate_py_impl"

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"

FASTDDS_CHOICES = ("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE", "FASTDDS_BUILTIN_TRANSPORTS")
"""Environment variables by which users choose Fast DDS's transports: a profile by its old and new name, or by kind."""


def prepare_environment(environment: MutableMapping[str, str] = os.environ) -> None:
    """Fill in what pip wheels of ROS leave open; values that the user has set stay.

    AMENT_PREFIX_PATH: the wheels install their index under the interpreter's prefix but do not say so.
    FASTRTPS_DEFAULT_PROFILES_FILE: the profile beside this file, where the user has made no choice about transports.
    Its datagrams fit an Ethernet frame: one that does not is lost with any of its fragments, so that large messages
    hardly get through a link that loses frames. Whether there will be other hosts is not known when a process starts;
    who knows that all learn on this one says so by ``send_to_this_host``.
    ROS_AUTOMATIC_DISCOVERY_RANGE: where it is LOCALHOST, ROS adds shared memory to whatever is set, and killed
    processes leave locks in it that may keep others from hearing each other. So it becomes SUBNET, and the profile
    keeps to this host.
    FASTDDS_BUILTIN_TRANSPORTS: for profiles of the user that leave it open; shared-memory files of killed processes
    slow every later discovery down.
    HOME: ROS's logging needs a home directory to write to.
    """
    if (Path(sys.prefix) / "share" / "ament_index").is_dir():
        environment.setdefault("AMENT_PREFIX_PATH", sys.prefix)
    if not any(name in environment for name in FASTDDS_CHOICES):
        local = environment.get(RANGE, "").upper() == "LOCALHOST"
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(LOOPBACK_PROFILE if local else FASTDDS_PROFILE)
        if local:
            environment[RANGE] = "SUBNET"
    environment.setdefault("FASTDDS_BUILTIN_TRANSPORTS", "UDPv4")
    environment.setdefault("HOME", str(Path.cwd()))


def load_type_support_alone() -> None:
    """Keep what generates messages' code out of a process that only uses it: a parser of grammars, and much else.

    ``rosidl_generator_py`` is loaded with the first message for one function, and brings its generator along if it can.
    The generator's own module can still be loaded.
    """
    if GENERATOR.partition(".")[0] in sys.modules:
        return
    modules: dict[str, Any] = sys.modules
    modules[GENERATOR] = None  # by which Python says: cannot be imported
    try:
        with suppress(ImportError):
            import_module(GENERATOR.partition(".")[0])
    finally:
        del modules[GENERATOR]


def send_to_this_host(environment: MutableMapping[str, str] = os.environ) -> None:
    """Let this process, and those that it starts, send large datagrams, unless the user has chosen transports.

    Others may still listen from other hosts. To be called before ROS is started.
    """
    if environment.get("FASTRTPS_DEFAULT_PROFILES_FILE") == str(FASTDDS_PROFILE):
        environment["FASTRTPS_DEFAULT_PROFILES_FILE"] = str(ONE_HOST_PROFILE)
