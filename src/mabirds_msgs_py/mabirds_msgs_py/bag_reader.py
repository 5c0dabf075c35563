"""Reading demonstrations from rosbag2 MCAP bags: verified when opened, then read through the index."""

import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import yaml
from mabirds_msgs.msg import Demonstration
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Footer, Message
from mcap.stream_reader import CRCValidationError, StreamReader
from rclpy.serialization import deserialize_message
from zstandard import ZstdError

from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_msgs_py.conversion import RefusedMessageError, read_demonstration
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.interfaces import type_hash, type_name
from mabirds_msgs_py.topics import bag_topic

DAMAGE = (McapError, CRCValidationError, ZstdError, RuntimeError, struct.error, ValueError, KeyError, EOFError)
"""What the readers raise on damaged files (lz4: RuntimeError; UnicodeDecodeError is a ValueError)."""

REMEDY = "the file is damaged or was not closed; fetch it again or record it anew"

Result = TypeVar("Result")


class _Place(NamedTuple):
    """Where a demonstration is: file and log time (nanoseconds)."""

    file: Path
    time: int


class DemonstrationBag:
    """The demonstrations of several learners in one bag.

    Opening reads everything once: checksums, types, iteration numbers 1, 2, ... without a gap, and every
    transition against the game. Raises BagError naming file, topic and iteration; also where a learner has fewer
    demonstrations than ``at_least``. To be closed, or used in a ``with`` statement.
    """

    def __init__(
        self, directory: Path, game: ConstrainedMarkovGame, learners: Sequence[str], at_least: int = 1
    ) -> None:
        self._game, self._at_least = game, at_least
        with ExitStack() as files:
            self._readers = {file: _open(file, files) for file in _files(directory)}
            self._places = {learner: self._index(directory, learner) for learner in learners}
            self._open_files = files.pop_all()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files; nothing can be read afterwards."""
        self._open_files.close()

    def count(self, learner: str) -> int:
        """How many demonstrations the learner has."""
        return len(self._places[learner])

    def time(self, learner: str, iteration: int) -> int:
        """When demonstration ``iteration`` (from 1) was recorded, in nanoseconds."""
        return self._places[learner][iteration - 1].time

    def message(self, learner: str, iteration: int) -> Demonstration:
        """Demonstration ``iteration`` (from 1), read through the file's index."""
        place = self._places[learner][iteration - 1]
        for message, _ in self._messages(place.file, bag_topic(learner), place.time):
            if message.iteration == iteration:
                return message
        raise BagError(
            f"{place.file}: topic {bag_topic(learner)}: iteration {iteration} has gone since the bag was opened"
        )

    def trajectories(self, learner: str) -> Iterator[Trajectories]:
        """All demonstrations of one learner, in order."""
        for iteration in range(1, self.count(learner) + 1):
            yield read_demonstration(self._game, learner, self.message(learner, iteration))

    def _index(self, directory: Path, learner: str) -> list[_Place]:
        topic, places = bag_topic(learner), list[_Place]()
        for file in self._readers:
            for message, time in self._messages(file, topic):
                where = f"{file}: topic {topic}: iteration {message.iteration}"
                if message.iteration != len(places) + 1:
                    raise BagError(f"{where}: expected iteration {len(places) + 1}; record the bag anew")
                try:
                    read_demonstration(self._game, learner, message)
                except RefusedMessageError as error:
                    raise BagError(f"{where}: {error}") from None
                places.append(_Place(file, time))
        if len(places) < self._at_least:
            raise BagError(
                f"{directory}: topic {topic}: {len(places)} demonstrations, expected at least {self._at_least};"
                " record more for these learners, or learn fewer"
            )
        return places

    def _messages(self, file: Path, topic: str, time: int | None = None) -> Iterator[tuple[Demonstration, int]]:
        """Messages of a topic with their log times; all, or those at one time."""
        messages = self._readers[file].iter_messages(topics=topic, starting_at=time, ending_at=time)
        while (found := _guarded(file, lambda: next(messages, None))) is not None:
            schema, channel, message = found
            _check_type(file, topic, schema, channel)
            try:
                yield deserialize_message(message.data, Demonstration), message.log_time
            except Exception as error:  # noqa: BLE001 - each middleware raises its own kinds
                raise BagError(f"{file}: topic {topic}: a message cannot be decoded ({error}); {REMEDY}") from None


def _files(directory: Path) -> list[Path]:
    """The bag's MCAP files in order."""
    metadata = directory / "metadata.yaml"
    try:
        information = yaml.safe_load(metadata.read_text(encoding="utf-8"))["rosbag2_bagfile_information"]
        storage, names = information["storage_identifier"], information["relative_file_paths"]
        files = [directory / str(name) for name in names]
    except OSError as error:
        raise BagError(f"{metadata}: cannot be read ({error.strerror}); give the directory of a rosbag2 bag") from None
    except (yaml.YAMLError, UnicodeDecodeError, TypeError, KeyError) as error:
        raise BagError(f"{metadata}: is not the metadata of a rosbag2 bag ({error})") from None
    if storage != "mcap":
        raise BagError(f"{metadata}: storage {storage!r}, expected 'mcap'; convert the bag with `ros2 bag convert`")
    return files


def _open(file: Path, files: ExitStack) -> McapReader:
    """A reader of a verified file, which ``files`` closes."""
    try:
        stream = files.enter_context(file.open("rb"))
    except OSError as error:
        raise BagError(f"{file}: cannot be read ({error.strerror})") from None
    _guarded(file, lambda: _verify(file))
    return make_reader(stream, validate_crcs=True)


def _verify(file: Path) -> None:
    """Read the whole file against the checksums of its chunks, data section and summary."""
    with file.open("rb") as stream:
        records = StreamReader(stream, validate_crcs=True).records
        # To the very end, past the footer: the closing magic is checked after it.
        (footer,) = [record for record in records if isinstance(record, Footer)]
        if stream.read(1):
            raise McapError("bytes after the end of the file")
        if footer.summary_start and footer.summary_crc:
            stream.seek(footer.summary_start)
            # The summary's checksum covers everything up to itself: 4 bytes of it and 8 of magic follow.
            summary = stream.read()[:-12]
            if zlib.crc32(summary) != footer.summary_crc:
                raise McapError("the checksum of the summary differs")


def _guarded(file: Path, read: Callable[[], Result]) -> Result:
    try:
        return read()
    except DAMAGE as error:
        raise BagError(f"{file}: {error or type(error).__name__}; {_intact(file)}; {REMEDY}") from None


def _intact(file: Path) -> str:
    """How far a damaged file can be read: the last intact iteration of each topic."""
    topics, counts = dict[int, str](), Counter[str]()
    with file.open("rb") as stream, suppress(*DAMAGE):
        for record in StreamReader(stream, validate_crcs=True).records:
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                counts[topics[record.channel_id]] += 1
    intact = [f"topic {topic}: iteration {counts[topic]}" for topic in sorted(counts)]
    return "intact up to " + (", ".join(intact) or "no iteration of any topic")


def _check_type(file: Path, topic: str, schema: Any, channel: Any) -> None:
    expected, expected_hash = type_name(Demonstration), type_hash(Demonstration)
    found = schema.name if schema else "no type"
    found_hash = channel.metadata.get("topic_type_hash", expected_hash)
    if (found, found_hash) != (expected, expected_hash):
        raise BagError(
            f"{file}: topic {topic}: type {found} ({found_hash}), expected {expected} ({expected_hash});"
            " record the bag anew with this version"
        )
