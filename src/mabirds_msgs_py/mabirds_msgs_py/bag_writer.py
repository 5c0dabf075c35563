"""Writing rosbag2 directories (metadata.yaml version 9, MCAP, CDR, ros2msg schemas), with every checksum on.

Stock ``ros2 bag`` and Foxglove open them. The metadata file is written last, so that a directory with one is whole.
"""

import shutil
from collections import Counter
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple, Self

import yaml
from mcap.writer import CompressionType, Writer
from rclpy.serialization import serialize_message

from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.interfaces import definition, type_hash, type_name

CHUNK_SIZE = 16 * 1024
"""Bytes; small, since damage anywhere costs a whole chunk."""

QOS_LATCHED = """- history: keep_last
  depth: 256
  reliability: reliable
  durability: transient_local
  deadline: {sec: 9223372036, nsec: 854775807}
  lifespan: {sec: 9223372036, nsec: 854775807}
  liveliness: automatic
  liveliness_lease_duration: {sec: 9223372036, nsec: 854775807}
  avoid_ros_namespace_conventions: false
"""


class TopicType(NamedTuple):
    """The type of a topic's messages: its name, its hash or "", its definition and what that is written in."""

    name: str
    hash: str
    definition: str
    encoding: str = "ros2msg"


def _topic_type(kind: type) -> TopicType:
    return TopicType(type_name(kind), type_hash(kind), definition(kind))


class _PlainDumper(yaml.SafeDumper):
    """YAML without anchors: values that stand twice are written twice, as rosbag2 does."""

    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002 - never an alias
        return True


class BagWriter:
    """One bag, as a context manager.

    Parameters
    ----------
    directory : Path
        Is made.
    keep : bool, optional
        Finish the bag after an error too, instead of removing it.

    Raises
    ------
    BagError
        The directory exists.
    """

    def __init__(self, directory: Path, *, keep: bool = False) -> None:
        self._keep = keep
        if directory.exists():
            raise BagError(f"{directory}: exists already; name another directory, or remove it first")
        directory.mkdir(parents=True)
        self._directory = directory
        self._file = directory / f"{directory.name}_0.mcap"
        self._stream = self._file.open("xb")
        self._writer = Writer(
            self._stream, chunk_size=CHUNK_SIZE, compression=CompressionType.ZSTD, enable_data_crcs=True
        )
        self._writer.start(profile="ros2", library=f"mabirds-{version('mabirds-msgs-py')}")
        self._channels: dict[str, tuple[int, TopicType]] = {}
        self._counts: Counter[str] = Counter()
        self._times: list[int] = []

    def __enter__(self) -> Self:
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        """Finish the bag, or remove it."""
        if error is None or self._keep:
            self.close()
        else:
            self._stream.close()
            shutil.rmtree(self._directory)

    def write(self, topic: str, message: Any, time: int, data: bytes | None = None) -> None:
        """Append a message.

        Parameters
        ----------
        topic : str
            Of the message.
        message : Any
            Of any ROS type.
        time : int
            Nanoseconds since the epoch.
        data : bytes, optional
            The message as CDR, where it is at hand.
        """
        if topic not in self._channels:
            self._register(topic, _topic_type(type(message)))
        self._append(topic, serialize_message(message) if data is None else data, time)

    def write_serialized(self, topic: str, kind: TopicType, data: bytes, time: int) -> None:
        """Append a message that is serialised already.

        Parameters
        ----------
        topic : str
            Of the message.
        kind : TopicType
            Of the topic; that of its first message counts.
        data : bytes
            CDR.
        time : int
            Nanoseconds since the epoch.
        """
        if topic not in self._channels:
            self._register(topic, kind)
        self._append(topic, data, time)

    def _append(self, topic: str, data: bytes, time: int) -> None:
        self._writer.add_message(
            channel_id=self._channels[topic][0],
            log_time=time,
            publish_time=time,
            sequence=self._counts[topic],
            data=data,
        )
        self._counts[topic] += 1
        self._times = [min([time, *self._times]), max([time, *self._times])]

    def _register(self, topic: str, kind: TopicType) -> None:
        schema = self._writer.register_schema(name=kind.name, encoding=kind.encoding, data=kind.definition.encode())
        channel = self._writer.register_channel(
            topic=topic,
            message_encoding="cdr",
            schema_id=schema,
            metadata={"offered_qos_profiles": QOS_LATCHED, "topic_type_hash": kind.hash},
        )
        self._channels[topic] = (channel, kind)

    def close(self) -> None:
        """Finish the file, then write the metadata that makes the directory a bag."""
        self._writer.finish()
        self._stream.close()
        text = yaml.dump({"rosbag2_bagfile_information": self._information()}, Dumper=_PlainDumper, sort_keys=False)
        (self._directory / "metadata.yaml").write_text(text, encoding="utf-8")

    def abandon(self) -> None:
        """Let go of the file as it is, where it cannot be written any more; ``repair`` saves what is in it."""
        with suppress(OSError):
            self._stream.close()

    def _information(self) -> dict[str, Any]:
        start, end = self._times or (0, 0)
        span = {"duration": {"nanoseconds": end - start}, "starting_time": {"nanoseconds_since_epoch": start}}
        total = sum(self._counts.values())
        return {
            "version": 9,
            "storage_identifier": "mcap",
            **span,
            "message_count": total,
            "topics_with_message_count": [self._topic(name) for name in self._channels],
            "compression_format": "",
            "compression_mode": "",
            "relative_file_paths": [self._file.name],
            "files": [{"path": self._file.name, **dict(reversed(span.items())), "message_count": total}],
            "custom_data": None,
            "ros_distro": "jazzy",
        }

    def _topic(self, name: str) -> dict[str, Any]:
        kind = self._channels[name][1]
        return {
            "topic_metadata": {
                "name": name,
                "type": kind.name,
                "serialization_format": "cdr",
                "offered_qos_profiles": yaml.safe_load(QOS_LATCHED),
                "type_description_hash": kind.hash,
            },
            "message_count": self._counts[name],
        }
