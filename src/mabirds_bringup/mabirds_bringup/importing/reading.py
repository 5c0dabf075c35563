"""Reading recordings: any bag that ``rosbags`` reads, and CSV files of frame, agent, x, y."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import polars as pl
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

from mabirds_bringup.importing.rules import ImportRules
from mabirds_bringup.importing.tracks import Track
from mabirds_msgs_py.errors import BagError

NANOSECONDS = 1e9

COLUMNS = ("frame", "agent", "x", "y")


class Sample(NamedTuple):
    """One message about one agent; seconds since the recording's epoch, metres."""

    agent: str
    frame: str
    stamp: float
    received: float
    x: float
    y: float


Places = Callable[[str, Any], Iterator[tuple[str, Any, Any]]]
"""From a topic and its message to agents, headers and points."""


def _odometry(topic: str, message: Any) -> Iterator[tuple[str, Any, Any]]:
    yield topic, message.header, message.pose.pose.position


def _pose(topic: str, message: Any) -> Iterator[tuple[str, Any, Any]]:
    yield topic, message.header, message.pose.position


def _transforms(topic: str, message: Any) -> Iterator[tuple[str, Any, Any]]:  # noqa: ARG001 - frames have names
    for transform in message.transforms:
        yield transform.child_frame_id, transform.header, transform.transform.translation


TYPES: Mapping[str, Places] = {
    "nav_msgs/msg/Odometry": _odometry,
    "geometry_msgs/msg/PoseStamped": _pose,
    "tf2_msgs/msg/TFMessage": _transforms,
}
"""Messages that tell places."""


def read_recording(path: Path, rules: ImportRules) -> list[Track]:
    """What was recorded of all agents.

    Parameters
    ----------
    path : Path
        A CSV file, or a bag.
    rules : ImportRules
        Which clock counts, and who is an expert.

    Returns
    -------
    list[Track]
        As recorded, in the order of the agents' names.

    Raises
    ------
    BagError
        It cannot be read, or its frames or clocks do not agree.
    """
    if not path.exists():
        raise BagError(f"{path}: there is no such recording; give a CSV file or the directory of a bag")
    if path.suffix.lower() == ".csv":
        return read_csv(path, rules.frames_per_second)
    by_agent = dict[str, list[Sample]]()
    for sample in _samples(path):
        by_agent.setdefault(sample.agent, []).append(sample)
    named = {expert.agent for expert in rules.experts if expert.agent}
    chosen = {name: samples for name, samples in sorted(by_agent.items()) if not named or name in named}
    _check_frames(path, chosen)
    if rules.clock == "header":
        _check_clocks(path, chosen, rules.limits.clock_offset)
    return [_track(path, name, samples, rules.clock) for name, samples in chosen.items()]


def _samples(path: Path) -> Iterator[Sample]:
    try:
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_JAZZY)) as reader:
            connections = [of for of in reader.connections if of.msgtype in TYPES]
            if not connections:
                raise BagError(
                    f"{path}: its topics are {_topics(reader.connections)}; expected one of {', '.join(TYPES)}"
                )
            for connection, time, data in reader.messages(connections=connections):
                message = reader.deserialize(data, connection.msgtype)
                for agent, header, point in TYPES[connection.msgtype](connection.topic, message):
                    stamp = header.stamp.sec + header.stamp.nanosec / NANOSECONDS
                    yield Sample(agent, header.frame_id, stamp, time / NANOSECONDS, point.x, point.y)
    except (AnyReaderError, OSError) as error:
        raise BagError(f"{path}: cannot be read as a bag ({error}); repair it, or record it anew") from None


def _topics(connections: Sequence[Any]) -> str:
    return ", ".join(sorted(f"{of.topic} ({of.msgtype})" for of in connections)) or "none"


def _check_frames(path: Path, by_agent: Mapping[str, Sequence[Sample]]) -> None:
    frames = {agent: sorted({sample.frame for sample in samples}) for agent, samples in by_agent.items()}
    if len({frame for names in frames.values() for frame in names}) > 1:
        words = ", ".join(f"{agent} in {' and '.join(map(repr, names))}" for agent, names in frames.items())
        raise BagError(f"{path}: places are told in different frames: {words}; record all in one, such as map")


def _check_clocks(path: Path, by_agent: Mapping[str, Sequence[Sample]], most: float) -> None:
    """Stamps of all agents must be as far from the recorder's clock."""
    offsets = {
        agent: float(np.median([sample.stamp - sample.received for sample in samples]))
        for agent, samples in by_agent.items()
    }
    if offsets and max(offsets.values()) - min(offsets.values()) > most:
        words = ", ".join(f"{agent} {offset:+.3f} s" for agent, offset in offsets.items())
        raise BagError(
            f"{path}: clocks are {max(offsets.values()) - min(offsets.values()):.3f} s apart, expected at most"
            f" {most:g}: stamps against the recorder's clock: {words}; set the clocks, or take clock: received"
        )


def _track(path: Path, agent: str, samples: Sequence[Sample], clock: str) -> Track:
    times = [sample.stamp if clock == "header" else sample.received for sample in samples]
    places = np.array([(sample.x, sample.y) for sample in samples], dtype=np.float64)
    return Track(str(path), agent, np.array(times, dtype=np.float64), places)


def read_csv(path: Path, rate: float) -> list[Track]:
    """Tracks of a CSV file with the columns frame, agent, x, y [m]; others are not looked at.

    Parameters
    ----------
    path : Path
        With a line of headings.
    rate : float
        Frames a second.

    Returns
    -------
    list[Track]
        In the order of the agents' names.

    Raises
    ------
    BagError
        A column is missing, or holds what is no number.
    """
    try:
        table = pl.read_csv(path, infer_schema=False)
    except (pl.exceptions.PolarsError, OSError) as error:
        raise BagError(f"{path}: is no CSV file ({error}); expected columns {', '.join(COLUMNS)}") from None
    if missing := [name for name in COLUMNS if name not in table.columns]:
        raise BagError(f"{path}: there is no column {', '.join(missing)}; expected {', '.join(COLUMNS)}")
    try:
        table = table.with_columns(pl.col("frame", "x", "y").str.strip_chars().cast(pl.Float64))
    except pl.exceptions.PolarsError as error:
        raise BagError(f"{path}: frame, x and y: expected numbers ({error}); correct them") from None
    return [
        Track(str(path), str(agent), *_columns(rows, rate))
        for (agent,), rows in sorted(table.group_by("agent", maintain_order=True))
    ]


def _columns(rows: pl.DataFrame, rate: float) -> tuple[Any, Any]:
    empty = rows.select(pl.col("frame", "x", "y").fill_null(float("nan"))).to_numpy()
    return empty[:, 0] / rate, empty[:, 1:]
