"""Bags for the fuzz tests: the same messages in every layout that MCAP has, and files whose lengths lie."""

import io
import struct
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import zstandard
from mcap.data_stream import RecordBuilder
from mcap.reader import make_reader
from mcap.records import Channel, Chunk, DataEnd, Footer, Header, McapRecord, Message, Schema
from mcap.writer import CompressionType, Writer

MAGIC = b"\x89MCAP0\r\n"

LAYOUTS: dict[str, dict[str, Any]] = {
    "zstd": {"compression": CompressionType.ZSTD, "chunk_size": 2000},
    "lz4": {"compression": CompressionType.LZ4, "chunk_size": 2000},
    "plain": {"compression": CompressionType.NONE, "chunk_size": 2000},
    "unchunked": {"use_chunking": False},
}
"""Without checksums, so that damage reaches every part of the reader."""


def mcap_file(bag: Path) -> Path:
    return next(bag.glob("*.mcap"))


def rewritten(content: bytes, layout: str) -> bytes:
    """The messages of an MCAP file in another layout, without checksums."""
    result, channels = io.BytesIO(), dict[int, int]()
    writer = Writer(result, enable_crcs=False, **LAYOUTS[layout])
    writer.start(profile="ros2", library="test")
    for schema, channel, message in make_reader(io.BytesIO(content)).iter_messages():
        assert schema is not None
        if channel.id not in channels:
            number = writer.register_schema(schema.name, schema.encoding, schema.data)
            channels[channel.id] = writer.register_channel(channel.topic, "cdr", number, channel.metadata)
        writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time, message.sequence)
    writer.finish()
    return result.getvalue()


def records(*contents: McapRecord) -> bytes:
    builder = RecordBuilder()
    for content in contents:
        content.write(builder)
    return builder.end()


def file_of(*contents: McapRecord) -> bytes:
    """A whole MCAP file without a summary."""
    return MAGIC + records(Header("ros2", "test"), *contents, DataEnd(0), Footer(0, 0, 0)) + MAGIC


def chunk(data: bytes, size: int, compression: str = "zstd") -> Chunk:
    return Chunk(compression, data, 0, 0, uncompressed_crc=0, uncompressed_size=size)


def zeros(size: int) -> bytes:
    """So many of them, compressed to a few bytes without ever being there."""
    compressor = zstandard.ZstdCompressor().compressobj(size=size)
    piece = bytes(2**20)
    return b"".join([*(compressor.compress(piece) for _ in range(size // len(piece))), compressor.flush()])


def with_message(content: bytes, change: Callable[[bytes], bytes]) -> bytes:
    """An MCAP file with the first message of another one, its bytes changed."""
    schema, channel, message = next(make_reader(io.BytesIO(content)).iter_messages())
    assert schema is not None
    inside = records(
        Schema(id=1, name=schema.name, encoding=schema.encoding, data=schema.data),
        Channel(id=1, schema_id=1, topic=channel.topic, message_encoding="cdr", metadata=channel.metadata),
        Message(channel_id=1, log_time=0, publish_time=0, sequence=0, data=change(message.data)),
    )
    return file_of(chunk(inside, len(inside), ""))


def lies(content: bytes) -> Iterator[tuple[str, bytes, str]]:
    """MCAP files that claim to hold gigabytes: a name, the file, what the refusal must say."""
    for exponent in (33, 62, 64):
        claim = struct.pack("<Q", 2**exponent - 1)
        yield f"record of 2^{exponent} bytes", MAGIC + b"\x01" + claim + content[17:], "has length"
    yield "string of 2^32 bytes", MAGIC + b"\x01" + struct.pack("<QI", 2**32, 2**32 - 1) + content[21:], "intact up to"
    head = struct.pack("<QQQII", 0, 0, 100, 0, 4) + b"zstd"
    yield (
        "chunk of 2^62 bytes",
        MAGIC + b"\x06" + struct.pack("<Q", len(head) + 108) + head + struct.pack("<Q", 2**62) + bytes(1000),
        "intact up to",
    )
    yield "honest bomb", file_of(chunk(zeros(2**30), 2**30)), "a record of kind 0"
    yield "bomb that says 100 bytes", file_of(chunk(zeros(2**30), 100)), "that has another size"
    empty_frame = b"\x28\xb5\x2f\xfd\xe0" + struct.pack("<Q", 2**40) + b"\x01\x00\x00"
    yield "frame that says 2^40 bytes", file_of(chunk(empty_frame, 100)), "that has another size"
    yield "unknown compression", file_of(chunk(b"", 0, "xz")), "compression 'xz', expected zstd, lz4 or none"
    yield "message of 2^32 numbers", with_message(content, _long_array), "a message cannot be decoded"


def _long_array(message: bytes) -> bytes:
    """The last array of a demonstration, of 16 numbers, says that it has many more."""
    place = message.rindex(struct.pack("<I", 16), 0, len(message) - 16 * 8)
    return message[:place] + struct.pack("<I", 2**32 - 1) + message[place + 4 :]
