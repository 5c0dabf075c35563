"""The same demonstrations in every kind of bag that people have, written by rosbags and by mcap's own writer."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import lz4.frame
import yaml
import zstandard
from mabirds_msgs.msg import Demonstration
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from mabirds_msgs_py.interfaces import definition, type_hash, type_name

MESSAGES = Path(__file__).resolve().parents[2] / "ros_ws" / "src" / "mabirds_msgs" / "msg"


class Entry(NamedTuple):
    """One message of a bag."""

    topic: str
    time: int
    message: Demonstration

    @property
    def data(self) -> bytes:
        return bytes(serialize_message(self.message))


class Layout(NamedTuple):
    """How mcap's own writer writes: its options, what becomes of each message's bytes, and the type hash."""

    options: dict[str, Any]
    change: Callable[[bytes], bytes] = bytes
    hash: str | None = None


PLAIN = Layout({"compression": CompressionType.NONE})
ZSTD = Layout({"compression": CompressionType.ZSTD})
LZ4 = Layout({"compression": CompressionType.LZ4})
UNCHUNKED = Layout({"use_chunking": False})


def write_mcap(
    file: Path, entries: list[Entry], layout: Layout = ZSTD, others: int = 0, beside: int | None = None
) -> None:
    """One MCAP file; before each of the first ``beside`` entries a message of another topic, of ``others`` bytes."""
    file.parent.mkdir(exist_ok=True)
    with file.open("wb") as stream:
        writer = Writer(stream, **layout.options)
        writer.start("ros2", "test")
        text, kind = definition(Demonstration).encode(), type_name(Demonstration)
        schema = writer.register_schema(kind, "ros2msg", text)
        metadata = {"topic_type_hash": type_hash(Demonstration) if layout.hash is None else layout.hash}
        topics = {entry.topic for entry in entries}
        channels = {topic: writer.register_channel(topic, "cdr", schema, metadata) for topic in sorted(topics)}
        other = writer.register_channel("/odometry", "cdr", writer.register_schema("x/msg/X", "ros2msg", b""), {})
        for number, entry in enumerate(entries):
            if others and (beside is None or number < beside):
                writer.add_message(other, entry.time, bytes(others), entry.time)
            writer.add_message(channels[entry.topic], entry.time, layout.change(entry.data), entry.time)
        writer.finish()


def write_metadata(bag: Path, **changes: Any) -> None:
    """A metadata.yaml as rosbag2 has it, as far as a reader looks at it."""
    information = {"version": 9, "storage_identifier": "mcap", **changes}
    text = yaml.safe_dump({"rosbag2_bagfile_information": information})
    (bag / "metadata.yaml").write_text(text, encoding="utf-8")


def write_rosbags(bag: Path, entries: list[Entry], mode: Any = None, storage: Any = StoragePlugin.MCAP) -> None:
    """A bag by the rosbags library."""
    store = get_typestore(Stores.ROS2_JAZZY)
    text = (MESSAGES / "Demonstration.msg").read_text(encoding="utf-8")
    store.register(get_types_from_msg(text, "mabirds_msgs/msg/Demonstration"))
    writer = RosbagsWriter(bag, version=9, storage_plugin=storage)
    if mode is not None:
        writer.set_compression(mode, CompressionFormat.ZSTD)
    with writer:
        topics = sorted({entry.topic for entry in entries})
        kind = "mabirds_msgs/msg/Demonstration"
        connections = {topic: writer.add_connection(topic, kind, typestore=store) for topic in topics}
        for entry in entries:
            writer.write(connections[entry.topic], entry.time, entry.data)


def halves(entries: list[Entry]) -> Iterator[list[Entry]]:
    yield entries[: len(entries) // 2]
    yield entries[len(entries) // 2 :]


def split(bag: Path, entries: list[Entry], order: tuple[int, int]) -> None:
    """Two files, named by the metadata in this order."""
    for number, part in enumerate(halves(entries)):
        write_mcap(bag / f"bag_{number}.mcap", part)
    write_metadata(bag, relative_file_paths=[f"bag_{number}.mcap" for number in order])


def compressed_file(bag: Path, entries: list[Entry], suffix: str, compress: Callable[[bytes], bytes]) -> None:
    """rosbag2's file compression."""
    write_mcap(bag / "bag_0.mcap", entries, PLAIN)
    content = (bag / "bag_0.mcap").read_bytes()
    (bag / f"bag_0.mcap.{suffix}").write_bytes(compress(content))
    (bag / "bag_0.mcap").unlink()
    names = [f"bag_0.mcap.{suffix}"]
    write_metadata(bag, relative_file_paths=names, compression_mode="FILE", compression_format=suffix)


def compressed_messages(bag: Path, entries: list[Entry], kind: str, compress: Callable[[bytes], bytes]) -> None:
    """rosbag2's message compression."""
    write_mcap(bag / "bag_0.mcap", entries, Layout({"compression": CompressionType.NONE}, compress))
    write_metadata(bag, relative_file_paths=["bag_0.mcap"], compression_mode="MESSAGE", compression_format=kind)


def shuffled(entries: list[Entry]) -> list[Entry]:
    """All at the same time, backwards."""
    return [entry._replace(time=7) for entry in reversed(entries)]


def played(entries: list[Entry]) -> list[Entry]:
    """As recorded from the network: each names the experiment that it was played to; one was sent twice."""
    for entry in entries:
        entry.message.experiment_digest = "of last week"
    return [*entries, entries[2]]


def across(bag: Path, entries: list[Entry]) -> None:
    """Every other message in the other file."""
    write_mcap(bag / "bag_0.mcap", entries[1::2])
    write_mcap(bag / "bag_1.mcap", entries[::2])


def half_compressed(bag: Path, entries: list[Entry]) -> None:
    """Old metadata name the file as it was before it was compressed."""
    compressed_file(bag, entries, "zstd", zstandard.compress)
    write_metadata(bag, relative_file_paths=["bag_0.mcap"])


def half_lost(bag: Path, entries: list[Entry]) -> None:
    write_rosbags(bag, entries)
    (bag / "metadata.yaml").unlink()


def half_plain(bag: Path, entries: list[Entry]) -> None:
    """Of two bags the one has the metadata of neither."""
    for number, part in enumerate(halves(entries)):
        write_mcap(bag / f"part_{number}.mcap", part, UNCHUNKED if number else PLAIN)


def moved(bag: Path, entries: list[Entry]) -> None:
    """A bag in the place of its file: the path is that of the .mcap."""
    write_mcap(bag.parent / "elsewhere" / "x.mcap", entries)
    (bag.parent / "elsewhere" / "x.mcap").rename(bag)


VARIANTS: dict[str, Callable[[Path, list[Entry]], None]] = {
    "reversed split list": lambda bag, entries: split(bag, entries, (1, 0)),
    "split": lambda bag, entries: split(bag, entries, (0, 1)),
    "messages across splits": across,
    "shuffled equal stamps": lambda bag, entries: write_mcap(bag / "a.mcap", shuffled(entries)),
    "exact duplicates": lambda bag, entries: write_mcap(bag / "a.mcap", [*entries, *entries[::3]]),
    "empty type hash": lambda bag, entries: write_mcap(bag / "a.mcap", entries, ZSTD._replace(hash="")),
    "zstd files": lambda bag, entries: compressed_file(bag, entries, "zstd", zstandard.compress),
    "lz4 files": lambda bag, entries: compressed_file(bag, entries, "lz4", lz4.frame.compress),
    "zstd messages": lambda bag, entries: compressed_messages(bag, entries, "zstd", zstandard.compress),
    "lz4 messages": lambda bag, entries: compressed_messages(bag, entries, "lz4", lz4.frame.compress),
    "rosbags": write_rosbags,
    "rosbags, zstd files": lambda bag, entries: write_rosbags(bag, entries, CompressionMode.FILE),
    "rosbags, zstd messages": lambda bag, entries: write_rosbags(bag, entries, CompressionMode.MESSAGE),
    "rosbags, zstd chunks": lambda bag, entries: write_rosbags(bag, entries, CompressionMode.STORAGE),
    "file named without its suffix": half_compressed,
    "no metadata": half_lost,
    "no metadata, two layouts": half_plain,
    "a single file": moved,
    "recorded live": lambda bag, entries: write_mcap(bag / "a.mcap", played(entries)),
    "unchunked": lambda bag, entries: write_mcap(bag / "a.mcap", entries, UNCHUNKED),
    "lz4 chunks": lambda bag, entries: write_mcap(
        bag / "a.mcap", entries, Layout({"compression": CompressionType.LZ4})
    ),
    "beside dense topics": lambda bag, entries: write_mcap(bag / "a.mcap", entries, ZSTD, others=200_000),
    "chunks of 100 MB": lambda bag, entries: write_mcap(
        bag / "a.mcap", entries, Layout({"compression": CompressionType.ZSTD, "chunk_size": 2**27}), others=9_000_000
    ),
    "messages of 70 MB": lambda bag, entries: write_mcap(bag / "a.mcap", entries, UNCHUNKED, 70_000_000, beside=2),
}
"""By name: writes entries, which are 6 demonstrations of each of two learners, to a bag."""
