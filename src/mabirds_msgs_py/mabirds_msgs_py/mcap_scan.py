"""MCAP files read from their first byte to their last, in bounded memory whatever their records and chunks are.

Chunks that hold nothing wanted are passed over, small chunks are taken into memory, large ones are decompressed as
they are read. Lengths are compared with what the file has before there is room made for them.
"""

import io
import struct
import zlib
from collections import Counter
from collections.abc import Callable, Iterator
from typing import IO, Any, NamedTuple, Protocol, cast

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Schema, Statistics

from mabirds_core.texts import truncate

MAGIC = b"\x89MCAP0\r\n"

MAX_RECORD = 64 * 2**20
"""Bytes of a record that is taken into memory: of a wanted message, a schema or a channel."""

SMALL_CHUNK = 8 * 2**20
"""Bytes of a chunk's content up to which it is decompressed at once: rosbag2's have less than one by default."""

WORTH_A_LOOK = 2**16
"""Bytes of a chunk in the file from which on its index is looked at first, for whether it holds what is wanted."""

PIECE = 2**20
"""Bytes that are passed over at once where seeking is not possible."""

ZSTD = zstandard.ZstdDecompressor(max_window_size=2**27)

HEAD = struct.Struct("<BQ")
MESSAGE = struct.Struct("<HIQQ")
CHUNK = struct.Struct("<QQQII")


class Readable(Protocol):
    """What records are read from."""

    def read(self, size: int, /) -> bytes:
        """At most ``size`` bytes."""


class Found(NamedTuple):
    """A wanted message: its channel, log time (nanoseconds since the epoch) and data."""

    channel: Channel
    time: int
    data: bytes


class _Limited:
    """The next ``size`` bytes of a stream."""

    def __init__(self, stream: Readable, size: int) -> None:
        self._stream, self._left = stream, size

    def read(self, size: int = -1, /) -> bytes:
        data = self._stream.read(self._left if size < 0 else min(size, self._left))
        self._left -= len(data)
        return data


class _Content:
    """What a chunk holds, decompressed as it is read; sized and checked against its checksum as it passes."""

    def __init__(self, stream: Readable, size: int) -> None:
        self._stream, self.left, self.crc = stream, size, 0

    def read(self, size: int, /) -> bytes:
        pieces, wanted = list[bytes](), min(size, self.left)
        while wanted and (piece := self._stream.read(wanted)):
            self.crc = zlib.crc32(piece, self.crc)
            wanted, self.left = wanted - len(piece), self.left - len(piece)
            pieces.append(piece)
        return pieces[0] if len(pieces) == 1 else b"".join(pieces)

    def pass_over(self, size: int) -> None:
        """Read on without keeping anything."""
        while size and (piece := self.read(min(size, PIECE))):
            size -= len(piece)

    @property
    def is_more(self) -> bool:
        """Does the stream go on past the size?"""
        return bool(self._stream.read(1))


class McapScan:
    """One pass through an MCAP file.

    Parameters
    ----------
    stream : IO[bytes]
        Of the file, at its beginning.
    wanted : Callable[[str], bool]
        Of which topics messages are wanted.
    """

    def __init__(self, stream: IO[bytes], wanted: Callable[[str], bool]) -> None:
        self._stream, self._wanted = stream, wanted
        self._size = stream.seek(0, io.SEEK_END)
        self.schemas = dict[int, Schema]()
        self.channels = dict[int, Channel]()
        self.counts = Counter[int]()
        """Messages by channel, as far as the pass has come."""
        self.statistics: Statistics | None = None
        self._taken = dict[int, bool]()
        self._chunks, self._indexed = list[int](), list[int]()
        self._data_end = (0, 0)
        stream.seek(0)

    def messages(self) -> Iterator[Found]:
        """The wanted messages, in the order of the file.

        Raises
        ------
        McapError
            The file is damaged or was not closed. The decompressors, struct and zlib raise their own errors.
        """
        if self._stream.read(len(MAGIC)) != MAGIC:
            raise McapError("it does not begin as an MCAP file does")
        while True:
            opcode, length = self._head()
            if opcode == Opcode.FOOTER:
                break
            if opcode == Opcode.CHUNK:
                yield from self._chunk(length)
            else:
                yield from self._record(self._stream, opcode, length, self._pass_over)
        self._end(length)

    def _head(self) -> tuple[int, int]:
        """Kind and length of the next record."""
        head = self._stream.read(HEAD.size)
        if len(head) < HEAD.size:
            raise McapError("it ends without a footer")
        opcode, length = HEAD.unpack(head)
        if length > self._size:
            raise McapError(f"a record has length {length}, more than the file")
        return opcode, length

    def _pass_over(self, size: int) -> None:
        self._stream.seek(size, io.SEEK_CUR)

    def _record(self, stream: Readable, opcode: int, length: int, pass_over: Callable[[int], None]) -> Iterator[Found]:
        """One record that is no chunk."""
        if opcode == Opcode.MESSAGE:
            yield from self._message(stream, length, pass_over)
        elif opcode == Opcode.CHUNK_INDEX:
            self._indexed.append(struct.unpack_from("<Q", _whole(stream, length), 16)[0])
        elif opcode == Opcode.DATA_END:
            self._data_end = (self._stream.tell() - HEAD.size, int.from_bytes(_whole(stream, length), "little"))
        elif opcode in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS):
            self._describe(opcode, ReadDataStream(io.BytesIO(_whole(stream, length))))
        elif opcode == 0:
            raise McapError("a record of kind 0, which none has")
        else:
            pass_over(length)

    def _describe(self, opcode: int, content: ReadDataStream) -> None:
        if opcode == Opcode.SCHEMA:
            schema = Schema.read(content)
            self.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(content)
            self.channels[channel.id] = channel
            self._taken[channel.id] = self._wanted(channel.topic)
        else:
            self.statistics = Statistics.read(content)

    def _message(self, stream: Readable, length: int, pass_over: Callable[[int], None]) -> Iterator[Found]:
        number, _, time, _ = MESSAGE.unpack(stream.read(MESSAGE.size))
        length -= MESSAGE.size
        if number not in self._taken:
            raise McapError(f"a message of channel {number}, which the file does not describe before it")
        self.counts[number] += 1
        if self._taken[number]:
            yield Found(self.channels[number], time, _whole(stream, length))
        else:
            pass_over(length)

    def _chunk(self, length: int) -> Iterator[Found]:
        start = self._stream.tell()
        end = start + length
        self._chunks.append(start - HEAD.size)
        _, _, size, crc, name_length = CHUNK.unpack(_whole(self._stream, CHUNK.size))
        name_length = min(name_length, 64)
        described = _whole(self._stream, name_length + 8)
        name, compressed = described[:name_length].decode(), int.from_bytes(described[name_length:], "little")
        if start + CHUNK.size + len(described) + compressed != end:
            raise McapError(f"a chunk whose data claim {compressed} bytes, other than its record has")
        if compressed < WORTH_A_LOOK or self._holds_wanted(end):
            yield from self._content(name, compressed, size, crc)
        self._stream.seek(end)

    def _content(self, name: str, compressed: int, size: int, crc: int) -> Iterator[Found]:
        """The wanted messages of a chunk, small ones only once their checksum is right."""
        if max(size, compressed) <= SMALL_CHUNK:
            content = _decompressed(name, _whole(self._stream, compressed), size)
            _check_content(len(content), size, zlib.crc32(content), crc)
            yield from self._within(io.BytesIO(content))
            return
        passing = _Content(self._decompressing(name, compressed, size), size)
        yield from self._within(passing)
        passing.pass_over(passing.left)
        _check_content(size - passing.left + passing.is_more, size, passing.crc, crc)

    def _holds_wanted(self, end: int) -> bool:
        """Do the index records after a chunk name a wanted channel, or one not known yet, or are there none?"""
        here, counts = self._stream.tell(), dict[int, int]()
        self._stream.seek(end)
        while end + HEAD.size < self._size:
            opcode, length = self._head()
            if opcode != Opcode.MESSAGE_INDEX:
                break
            number, entries = struct.unpack("<HI", _whole(self._stream, 6))
            counts[number] = entries // 16
            self._stream.seek(length - 6, io.SEEK_CUR)
        self._stream.seek(here)
        if not counts or any(self._taken.get(number, True) for number in counts):
            return True
        self.counts.update(counts)
        return False

    def _decompressing(self, name: str, compressed: int, size: int) -> Readable:
        """The content of a chunk as a stream."""
        start = self._stream.tell()
        _require_size(name, _whole(self._stream, min(compressed, 64)), compressed, size)
        self._stream.seek(start)
        data = _Limited(self._stream, compressed)
        if name == "zstd":
            return ZSTD.stream_reader(cast("IO[bytes]", data))
        return lz4.frame.LZ4FrameFile(data) if name == "lz4" else data

    def _within(self, content: Any) -> Iterator[Found]:
        """The wanted messages of a chunk."""

        def seek_on(size: int) -> None:
            content.seek(size, io.SEEK_CUR)

        pass_over = content.pass_over if isinstance(content, _Content) else seek_on
        while head := content.read(HEAD.size):
            opcode, length = HEAD.unpack(head)
            yield from self._record(content, opcode, length, pass_over)

    def _end(self, length: int) -> None:
        """The footer, the closing magic, and what checksums and counts say."""
        start, _, crc = struct.unpack("<QQI", _whole(self._stream, length))
        if self._stream.read(len(MAGIC)) != MAGIC:
            raise McapError("it does not end as an MCAP file does")
        if self._stream.read(1):
            raise McapError("bytes after the end of the file")
        if self._indexed and sorted(self._indexed) != self._chunks:
            raise McapError("the index of its chunks differs from its chunks")
        self._check_counts()
        # The summary's checksum covers everything up to itself: 4 bytes of it and 8 of magic follow.
        self._check_crc("summary", start, self._size - 12, crc if start else 0)
        self._check_crc("data section", 0, *self._data_end)

    def _check_counts(self) -> None:
        counts = self.statistics.channel_message_counts if self.statistics else {}
        for number, expected in counts.items():
            if self._taken.get(number) and self.counts[number] != expected:
                topic = self.channels[number].topic
                raise McapError(f"{self.counts[number]} messages of {topic}, of which its statistics name {expected}")

    def _check_crc(self, part: str, start: int, end: int, expected: int) -> None:
        if not expected:
            return
        self._stream.seek(start)
        content = _Content(self._stream, end - start)
        content.pass_over(content.left)
        if content.crc != expected:
            raise McapError(f"the checksum of the {part} differs")


def _whole(stream: Readable, length: int) -> bytes:
    """Exactly so many bytes, if so many may be in memory."""
    if length > MAX_RECORD:
        raise McapError(f"a record of {length} bytes, expected at most {MAX_RECORD}")
    data = stream.read(length)
    if len(data) < length:
        raise McapError(f"a record of {length} bytes ends after {len(data)}")
    return data


def _require_size(name: str, head: bytes, compressed: int, size: int) -> None:
    """Compare what a chunk says of its size with what its data say, before there is room made for it."""
    if name == "":
        fits = compressed == size
    elif name == "zstd":
        fits = zstandard.frame_content_size(head) in (-1, size)
    elif name == "lz4":
        fits = lz4.frame.get_frame_info(head)["content_size"] in (0, size)
    else:
        raise McapError(f"compression {truncate(name)!r}, expected zstd, lz4 or none")
    if not fits:
        raise _other_size(size)


def _decompressed(name: str, data: bytes, size: int) -> bytes:
    """The content of a small chunk; one byte more than its size where there is more."""
    _require_size(name, data[:64], len(data), size)
    if name == "zstd":
        return ZSTD.stream_reader(data).read(size + 1)
    if name == "lz4":
        return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))
    return data


def _check_content(found: int, size: int, crc: int, expected_crc: int) -> None:
    if found != size:
        raise _other_size(size)
    if expected_crc not in (0, crc):
        raise McapError(f"crc validation failed in a chunk, expected: {expected_crc}, calculated: {crc}")


def _other_size(size: int) -> McapError:
    return McapError(f"a chunk of {size} bytes that has another size")
