"""What ROS knows about a message type: its name, its text with all dependencies, its type hash (REP-2016)."""

import json
from functools import cache
from pathlib import Path
from typing import Any

from ament_index_python.packages import get_package_share_directory

from mabirds_msgs_py.environment import prepare_environment

SEPARATOR = "\n" + "=" * 80 + "\n"


def type_name(message_type: type) -> str:
    """Full name, such as "mabirds_msgs/msg/Demonstration"."""
    package = message_type.__module__.split(".")[0]
    return f"{package}/msg/{message_type.__name__}"


@cache
def type_hash(message_type: type) -> str:
    """RIHS01 hash of the type, as nodes announce it during discovery."""
    name = type_name(message_type)
    hashes = {entry["type_name"]: entry["hash_string"] for entry in _description(name)["type_hashes"]}
    return str(hashes[name])


def definition(message_type: type) -> str:
    """The .msg text followed by those of all types that it uses, as MCAP's "ros2msg" encoding wants it."""
    name = type_name(message_type)
    used = _description(name)["type_description_msg"]["referenced_type_descriptions"]
    texts = [_installed(name, ".msg").read_text(encoding="utf-8")]
    for other in (entry["type_name"] for entry in used):
        short = other.replace("/msg/", "/")
        texts.append(f"MSG: {short}\n{_installed(other, '.msg').read_text(encoding='utf-8')}")
    return SEPARATOR.join(texts)


def _description(name: str) -> Any:
    return json.loads(_installed(name, ".json").read_text(encoding="utf-8"))


def _installed(name: str, suffix: str) -> Path:
    """The file of an interface in its package's share directory."""
    prepare_environment()
    package, relative = name.split("/", 1)
    return Path(get_package_share_directory(package)) / f"{relative}{suffix}"
