"""Reading demonstrations from rosbag2 MCAP bags: verified when opened, then read through the index."""

import io
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any, NamedTuple, Self, TypeVar

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mabirds_msgs.msg import Demonstration
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, McapRecord, Message
from mcap.stream_reader import CRCValidationError, StreamReader, breakup_chunk
from rclpy.serialization import deserialize_message

from mabirds_core.errors import RefusedMessageError
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories
from mabirds_core.texts import sanitize, truncate
from mabirds_core.yaml_files import read_yaml
from mabirds_msgs_py.conversion import read_demonstration
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.interfaces import type_hash, type_name
from mabirds_msgs_py.topics import bag_topic

DAMAGE = (
    McapError,
    CRCValidationError,
    zstandard.ZstdError,
    RuntimeError,
    struct.error,
    ValueError,
    KeyError,
    EOFError,
    OverflowError,
    OSError,
)
"""What the readers raise on damaged files (lz4: RuntimeError; UnicodeDecodeError is a ValueError)."""

MAX_CHUNK = 64 * 2**20
"""Bytes of a chunk's content: a few compressed bytes can stand for gigabytes. Usual chunks have less than one."""

CHUNK_OVERHEAD = 49
"""Bytes of a chunk's record beside its data and the name of their compression."""

MAX_LIST = 1000
"""Characters of what an error says about the topics of a file."""

REMEDY = "the file is damaged or was not closed; fetch it again or record it anew"

OTHER_GAME = "the bag is of another game, or of a version before: record it anew, or name the bag of this game"

Result = TypeVar("Result")


class _Place(NamedTuple):
    """Where a demonstration is: file and log time (nanoseconds)."""

    file: Path
    time: int


class DemonstrationBag:
    """The demonstrations of several learners in one bag.

    Opening reads everything once: checksums, types, iteration numbers 1, 2, ... without a gap, and every
    transition against the game. To be closed, or used in a ``with`` statement.

    Parameters
    ----------
    directory : Path
        Of the bag.
    game : ConstrainedMarkovGame
        Of the demonstrations.
    learners : Sequence[str]
        Names of those whose demonstrations are read.
    at_least : int, optional
        Demonstrations that each of them must have.

    Raises
    ------
    BagError
        Something is wrong, or demonstrations are too few; the message names file, topic and iteration.
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
        """When a demonstration was recorded.

        Parameters
        ----------
        learner : str
            Its name.
        iteration : int
            Of the demonstration, from 1 on.

        Returns
        -------
        int
            Nanoseconds since the epoch.
        """
        return self._places[learner][iteration - 1].time

    def message(self, learner: str, iteration: int) -> Demonstration:
        """Read a demonstration through the file's index.

        Parameters
        ----------
        learner : str
            Its name.
        iteration : int
            Of the demonstration, from 1 on.

        Returns
        -------
        Demonstration
            As recorded.

        Raises
        ------
        BagError
            It has gone since the bag was opened.
        """
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
                    remedy = f"; {OTHER_GAME}" if error.reason == "wrong_game" else ""
                    raise BagError(f"{where}: {error}{remedy}") from None
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
        while (record := _guarded(file, lambda: next(messages, None))) is not None:
            schema, channel, message = record
            _check_type(file, topic, schema, channel)
            try:
                yield deserialize_message(message.data, Demonstration), message.log_time
            except Exception as error:  # noqa: BLE001 - each middleware raises its own kinds
                raise BagError(f"{file}: topic {topic}: a message cannot be decoded ({error}); {REMEDY}") from None


def _files(directory: Path) -> list[Path]:
    """The bag's MCAP files in order."""
    metadata = directory / "metadata.yaml"
    try:
        information = read_yaml(metadata)["rosbag2_bagfile_information"]
        storage, names = information["storage_identifier"], information["relative_file_paths"]
    except OSError as error:
        raise BagError(f"{metadata}: cannot be read ({error.strerror}); give the directory of a rosbag2 bag") from None
    except (ValueError, TypeError, KeyError) as error:
        raise BagError(f"{metadata}: is not the metadata of a rosbag2 bag ({error})") from None
    if storage != "mcap":
        raise BagError(
            f"{metadata}: storage {truncate(repr(storage))}, expected 'mcap'; convert the bag with `ros2 bag convert`"
        )
    if not _are_names(names):
        raise BagError(
            f"{metadata}: relative_file_paths {truncate(repr(names))}, expected different names of files beside it"
        )
    return [directory / name for name in names]


def _are_names(names: Any) -> bool:
    """A list of different names of files, none of them elsewhere?"""
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        return False
    return len(set(names)) == len(names) and all(name == Path(name).name and "\0" not in name for name in names)


class _BoundedFile(io.BufferedReader):
    """A file that makes room for no more than it has, whatever length a damaged record claims."""

    def __init__(self, file: Path) -> None:
        super().__init__(io.FileIO(file))
        self._size = file.stat().st_size

    def read(self, size: int | None = -1, /) -> bytes:
        """Read as from every file, but never ask for more than it has."""
        return super().read(size if size is None else min(size, self._size))


def _open(file: Path, files: ExitStack) -> McapReader:
    """A reader of a verified file, which ``files`` closes."""
    try:
        if not (file.is_file() or file.is_dir() or not file.exists()):
            raise BagError(f"{file}: is no file but a pipe or device; name a bag of files")
        stream = files.enter_context(_BoundedFile(file))
    except OSError as error:
        raise BagError(f"{file}: cannot be read ({error.strerror})") from None
    _guarded(file, lambda: _verify(file))
    return _guarded(file, lambda: make_reader(stream, validate_crcs=True))


def _verify(file: Path) -> None:
    """Read the whole file against the checksums of its chunks, data section and summary, and against its index."""
    chunks, indexed, footer = list[int](), list[int](), Footer(0, 0, 0)
    with _BoundedFile(file) as stream:
        # To the very end, past the footer: the closing magic is checked after it.
        for record in _records(stream):
            if isinstance(record, Chunk):
                chunks.append(stream.tell() - CHUNK_OVERHEAD - len(record.compression) - len(record.data))
            elif isinstance(record, ChunkIndex):
                indexed.append(record.chunk_start_offset)
            elif isinstance(record, Footer):
                footer = record
        if stream.read(1):
            raise McapError("bytes after the end of the file")
        if indexed and sorted(indexed) != chunks:
            raise McapError("the index of its chunks differs from its chunks")
        _verify_summary(stream, footer)


def _verify_summary(stream: _BoundedFile, footer: Footer) -> None:
    if footer.summary_start and footer.summary_crc:
        stream.seek(footer.summary_start)
        # The summary's checksum covers everything up to itself: 4 bytes of it and 8 of magic follow.
        summary = stream.read()[:-12]
        if zlib.crc32(summary) != footer.summary_crc:
            raise McapError("the checksum of the summary differs")


def _records(stream: _BoundedFile) -> Iterator[McapRecord]:
    """All records; after each chunk those in it, whose size is looked at before there is room made for them."""
    for record in StreamReader(stream, emit_chunks=True, validate_crcs=True).records:
        yield record
        if isinstance(record, Chunk):
            if record.uncompressed_size > MAX_CHUNK or _declared_size(record) != record.uncompressed_size:
                raise McapError(f"a chunk of {record.uncompressed_size} bytes that has another size, or is too large")
            yield from breakup_chunk(record, validate_crc=True)


def _declared_size(chunk: Chunk) -> int:
    """Size of a chunk's content as its compressed data say; where they do not, as the chunk says."""
    match chunk.compression:
        case "zstd":
            size = zstandard.frame_content_size(chunk.data)
            return chunk.uncompressed_size if size < 0 else size
        case "lz4":
            return lz4.frame.get_frame_info(chunk.data)["content_size"] or chunk.uncompressed_size
        case "":
            return len(chunk.data)
    raise McapError(f"compression {truncate(chunk.compression)!r}, expected zstd, lz4 or none")


def _guarded(file: Path, read: Callable[[], Result]) -> Result:
    try:
        return read()
    except DAMAGE as error:
        raise BagError(f"{file}: {_reason(error)}; {_intact(file)}; {REMEDY}") from None


def _reason(error: Exception) -> str:
    if isinstance(error, KeyError):  # its text is the key alone
        return f"{sanitize(str(error))} is named in it, and is not there"
    return sanitize(str(error)) or type(error).__name__


def _intact(file: Path) -> str:
    """How far a damaged file can be read: the last intact iteration of each topic."""
    topics, counts = dict[int, str](), Counter[str]()
    with suppress(*DAMAGE), _BoundedFile(file) as stream:
        for record in _records(stream):
            if isinstance(record, Channel):
                topics[record.id] = record.topic
            elif isinstance(record, Message):
                counts[topics[record.channel_id]] += 1
    intact = [f"topic {sanitize(topic)}: iteration {counts[topic]}" for topic in sorted(counts)]
    return "intact up to " + (truncate(", ".join(intact), MAX_LIST) or "no iteration of any topic")


def _check_type(file: Path, topic: str, schema: Any, channel: Any) -> None:
    expected, expected_hash = type_name(Demonstration), type_hash(Demonstration)
    name = schema.name if schema else "no type"
    given_hash = channel.metadata.get("topic_type_hash", expected_hash)
    if (name, given_hash) != (expected, expected_hash):
        raise BagError(
            f"{file}: topic {topic}: type {sanitize(name)} ({sanitize(given_hash)}), expected {expected}"
            f" ({expected_hash});"
            " record the bag anew with this version"
        )
