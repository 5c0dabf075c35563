"""A recording to try `mabirds import` with: two robots that pass each other in a hall, as odometry.

    python tools/two_robots.py try
    python tools/two_robots.py try --pictures docs/images

They wait, their places are noisy, they are recorded at other rates, and one is not heard for some seconds. Needs
rosbags, as `mabirds import` does. With --pictures, the commands of docs/own-recordings.md are run as well, and their
pictures copied.
"""

import argparse
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

Array = NDArray[np.float64]

STORE = get_typestore(Stores.ROS2_JAZZY)
KIND = STORE.types
ODOMETRY = "nav_msgs/msg/Odometry"

HOMES = np.array([[1.0, 1.0], [9.0, 2.0]])
GOALS = np.array([[9.0, 1.0], [1.0, 2.0]])
"""Of the two robots [m]."""

RATES = (20.0, 13.0)
"""Samples a second."""

SPEED, NOISE, CROSSINGS = 0.8, 0.01, 24
"""m/s, m, and how often they pass each other on their way out; on their way back they do as well."""

GAP = (100.0, 103.0)
"""When robot 2 is not heard [s]."""

RULES = """\
name: robots
experts:
  - {agent: /robot_1/odom, enter: {centre: [1.0, 1.0], radius: 0.4}, goal: {centre: [9.0, 1.0], radius: 0.4}}
  - {agent: /robot_2/odom, enter: {centre: [9.0, 2.0], radius: 0.4}, goal: {centre: [1.0, 2.0], radius: 0.4}}
area: {corners: [[0.0, 0.0], [10.0, 3.0]]}
episodes: {by: regions}
steps: {time_step: 1.0}
learners: {count: 2, passes: 3}
held_out: 0.3
game: {kind: drones}
"""


def driven(rng: np.random.Generator) -> tuple[Array, Array]:
    """Times (n,) and places (n, 2, 2) between which both drive straight: out, with a wait, and back."""
    now, times, places = 0.0, [0.0], [HOMES]
    for _ in range(CROSSINGS):
        for here, there in ((HOMES, GOALS), (GOALS, HOMES)):
            # Robot 1 gives way: it turns aside in the middle, and waits there now and then.
            middle = (here + there) / 2 + np.array([[0.0, rng.uniform(-0.5, -0.2)], [0.0, rng.uniform(0.0, 0.2)]])
            waits = float(rng.choice([0.0, 1.5], p=[0.7, 0.3]))
            for place, lasts in ((middle, 4 / SPEED), (middle, waits), (there, 4 / SPEED), (there, rng.uniform(1, 2))):
                if lasts:
                    now += lasts
                    times.append(now)
                    places.append(place)
    return np.array(times), np.array(places)


def odometry(stamp: float, place: Array) -> Any:
    """A message of a robot that is at a place [m] at a time [s]."""
    vector, pose = KIND["geometry_msgs/msg/Vector3"], KIND["geometry_msgs/msg/Pose"]
    turn = KIND["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    point = KIND["geometry_msgs/msg/Point"](float(place[0]), float(place[1]), 0.0)
    whole = KIND["geometry_msgs/msg/PoseWithCovariance"](pose(point, turn), np.zeros(36))
    twist = KIND["geometry_msgs/msg/Twist"](vector(0.0, 0.0, 0.0), vector(0.0, 0.0, 0.0))
    seconds, rest = divmod(round(stamp * 1e9), 10**9)
    header = KIND["std_msgs/msg/Header"](KIND["builtin_interfaces/msg/Time"](seconds, rest), "map")
    moving = KIND["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
    return KIND[ODOMETRY](header, "base_link", whole, moving)


def samples(robot: int, times: Array, places: Array, rng: np.random.Generator) -> Iterator[tuple[float, Array]]:
    """When and where a robot says that it is."""
    for stamp in np.arange(times[0], times[-1], 1 / RATES[robot]):
        if robot == 1 and GAP[0] <= stamp < GAP[1]:
            continue
        there = [np.interp(stamp, times, places[:, robot, axis]) for axis in (0, 1)]
        yield float(stamp), np.array(there) + NOISE * rng.standard_normal(2)


def write_recording(directory: Path) -> None:
    """A bag and rules for it."""
    rng = np.random.default_rng(1)
    times, places = driven(rng)
    directory.mkdir(parents=True, exist_ok=True)
    (directory / "rules.yaml").write_text(RULES, encoding="utf-8")
    with Writer(directory / "recording", version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for robot in range(2):
            connection = writer.add_connection(f"/robot_{robot + 1}/odom", ODOMETRY, typestore=STORE)
            for stamp, place in samples(robot, times, places, rng):
                message = STORE.serialize_cdr(odometry(stamp, place), ODOMETRY)
                writer.write(connection, round(stamp * 1e9), message)


def run(directory: Path, *words: str) -> None:
    """A command of mabirds in a directory."""
    subprocess.run([str(Path(sys.executable).with_name("mabirds")), *words], cwd=directory, check=True)


def draw(directory: Path, pictures: Path) -> None:
    """Do what docs/own-recordings.md says, and copy the pictures."""
    run(directory, "import", "recording", "--rules", "rules.yaml", "--out", "mine")
    run(directory, "simulate", "mine/experiment.yaml")
    run(directory, "evaluate", "runs/latest", "--bag", "mine/held_out")
    for source, name in (("mine/import.png", "import.png"), ("runs/latest/map.png", "recorded_robots.png")):
        shutil.copy(directory / source, pictures / name)


def main() -> None:
    """Entry point."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("directory", type=Path, help="is made")
    parser.add_argument("--pictures", type=Path, help="directory for the pictures of the document")
    arguments = parser.parse_args()
    write_recording(arguments.directory)
    if arguments.pictures:
        draw(arguments.directory, arguments.pictures)


if __name__ == "__main__":
    main()
