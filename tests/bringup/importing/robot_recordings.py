"""Recordings of two robots, written by an independent library."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from mabirds_core.arrays import Array, Vector

STORE = get_typestore(Stores.ROS2_JAZZY)
KIND = STORE.types

ONE, OTHER = "/robot_1/odom", "/robot_2/odom"

RULES: dict[str, Any] = {
    "name": "robots",
    "experts": [
        {
            "agent": ONE,
            "goal": {"centre": [9.0, 1.0], "radius": 0.4},
            "enter": {"centre": [1.0, 1.0], "radius": 0.4},
        },
        {
            "agent": OTHER,
            "goal": {"centre": [1.0, 2.0], "radius": 0.4},
            "enter": {"centre": [9.0, 2.0], "radius": 0.4},
        },
    ],
    "area": {"corners": [[0.0, 0.0], [10.0, 3.0]]},
    "episodes": {"by": "regions"},
    "steps": {"time_step": 1.0},
    "learners": {"count": 2},
    "game": {"kind": "drones"},
}
"""Two robots that pass each other in a hall of 10 m times 3 m."""


def header(stamp: float, frame: str = "map") -> Any:
    seconds, rest = divmod(round(stamp * 1e9), 10**9)
    return KIND["std_msgs/msg/Header"](KIND["builtin_interfaces/msg/Time"](seconds, rest), frame)


def odometry(stamp: float, place: Array, frame: str = "map") -> Any:
    vector, turn = KIND["geometry_msgs/msg/Vector3"], KIND["geometry_msgs/msg/Quaternion"]
    point = KIND["geometry_msgs/msg/Point"](float(place[0]), float(place[1]), 0.0)
    pose = KIND["geometry_msgs/msg/PoseWithCovariance"](
        KIND["geometry_msgs/msg/Pose"](point, turn(0.0, 0.0, 0.0, 1.0)), np.zeros(36)
    )
    twist = KIND["geometry_msgs/msg/Twist"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    whole = KIND["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
    return KIND["nav_msgs/msg/Odometry"](header(stamp, frame), "base_link", pose, whole)


def pose_stamped(stamp: float, place: Array, frame: str = "map") -> Any:
    point = KIND["geometry_msgs/msg/Point"](float(place[0]), float(place[1]), 0.0)
    pose = KIND["geometry_msgs/msg/Pose"](point, KIND["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0))
    return KIND["geometry_msgs/msg/PoseStamped"](header(stamp, frame), pose)


def transform(stamp: float, place: Array, child: str) -> Any:
    shift = KIND["geometry_msgs/msg/Vector3"](float(place[0]), float(place[1]), 0.0)
    turn = KIND["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    whole = KIND["geometry_msgs/msg/Transform"](shift, turn)
    one = KIND["geometry_msgs/msg/TransformStamped"](header(stamp), child, whole)
    return KIND["tf2_msgs/msg/TFMessage"]([one])


def write_bag(
    path: Path, messages: Mapping[str, list[tuple[float, Any]]], storage: StoragePlugin = StoragePlugin.MCAP
) -> Path:
    """A bag of messages by topic, each with the time at which it was received [s]."""
    with Writer(path, version=9, storage_plugin=storage) as writer:
        for topic, entries in messages.items():
            kind = entries[0][1].__msgtype__
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for time, message in entries:
                writer.write(connection, round(time * 1e9), STORE.serialize_cdr(message, kind))
    return path


def crossings(count: int, rng: np.random.Generator, speed: float = 0.8) -> tuple[Vector, Array]:
    """Two robots that wait, pass each other and drive back, ``count`` times: times (n,) and places (n, 2, 2)."""
    knots, times, now = list[Array](), list[float](), 0.0
    homes, goals = np.array([[1.0, 1.0], [9.0, 2.0]]), np.array([[9.0, 1.0], [1.0, 2.0]])
    for _ in range(count):
        for aims in (homes, goals):
            middle = (homes + goals) / 2 + rng.uniform(-0.2, 0.2, (2, 2))
            for place, stay in ((middle, 4 / speed), (aims, 4 / speed), (aims, float(rng.uniform(1.0, 2.0)))):
                now += stay
                knots.append(place)
                times.append(now)
    return np.array(times), np.array(knots)


def sampled(times: Vector, knots: Array, agent: int, rate: float) -> tuple[Vector, Array]:
    """One agent's places at a rate of its own [1/s]."""
    stamps = np.arange(times[0], times[-1], 1 / rate)
    return stamps, np.column_stack([np.interp(stamps, times, knots[:, agent, axis]) for axis in (0, 1)])


def robots_bag(path: Path, count: int = 6, noise: float = 0.01, seed: int = 1) -> Path:
    """Two robots with noise and other rates."""
    rng = np.random.default_rng(seed)
    times, knots = crossings(count, rng)
    messages = {}
    for agent, (topic, rate) in enumerate(((ONE, 20.0), (OTHER, 13.0))):
        stamps, places = sampled(times, knots, agent, rate)
        noisy = places + noise * rng.standard_normal(places.shape)
        messages[topic] = [(t, odometry(t, p)) for t, p in zip(stamps, noisy, strict=True)]
    return write_bag(path, messages)
