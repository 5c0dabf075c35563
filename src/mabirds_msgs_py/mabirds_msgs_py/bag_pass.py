"""One pass through a file of a bag, with damage told as people need to know it."""

import struct
from collections import Counter
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import lz4.frame  # type: ignore[import-untyped]
import zstandard
from mcap.exceptions import McapError
from mcap.records import Channel, Schema

from mabirds_core.texts import sanitize, truncate
from mabirds_msgs_py.bag_files import LZ4, ZSTD, open_mcap
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.mcap_scan import MAX_RECORD, Found, McapScan

DAMAGE = (
    McapError,
    zstandard.ZstdError,
    RuntimeError,
    struct.error,
    ValueError,
    KeyError,
    IndexError,
    EOFError,
    OverflowError,
    OSError,
)
"""What readers raise on damaged files (lz4: RuntimeError; UnicodeDecodeError is a ValueError)."""

MAX_LIST = 1000
"""Characters of what an error says about the topics of a file."""

REMEDY = "the file is damaged or was not closed; fetch it again or record it anew; `mabirds bag repair` saves the rest"


def read_file(
    file: Path,
    wanted: Callable[[str], bool],
    take: Callable[[Found, McapScan], None],
    check: Callable[[Channel, Schema | None], None] = lambda _, __: None,
) -> Counter[str]:
    """Give all messages of some topics to ``take``.

    Parameters
    ----------
    file : Path
        An MCAP file.
    wanted : Callable[[str], bool]
        Which topics.
    take : Callable[[Found, McapScan], None]
        Is given each message, and the pass that found it.
    check : Callable[[Channel, Schema | None], None], optional
        Is given each channel with its type before its first message.

    Returns
    -------
    Counter[str]
        Messages by topic, of all topics.

    Raises
    ------
    BagError
        The file is damaged, or ``take`` or ``check`` say so.
    """
    checked = set[int]()
    with open_mcap(file) as stream:
        scan = McapScan(stream, wanted)
        try:
            for found in scan.messages():
                if found.channel.id not in checked:
                    check(found.channel, scan.schemas.get(found.channel.schema_id))
                    checked.add(found.channel.id)
                take(found, scan)
        except BagError:
            raise
        except DAMAGE as error:
            raise BagError(f"{file}: {_reason(error)}; {_intact(file)}; {REMEDY}") from None
    counts = Counter[str]()
    for channel, count in scan.counts.items():
        counts[scan.channels[channel].topic] += count
    return counts


def message_data(data: bytes) -> bytes:
    """A message as it was serialised; rosbag2's message compression is undone.

    Plain CDR begins with a zero byte, so that a compressed message cannot be taken for one that is not.

    Parameters
    ----------
    data : bytes
        As in the file.

    Returns
    -------
    bytes
        At most MAX_RECORD of them.

    Raises
    ------
    ValueError
        It is larger; the decompressors raise errors of their own.
    """
    if data.startswith(ZSTD):
        plain = zstandard.ZstdDecompressor(max_window_size=2**27).stream_reader(data).read(MAX_RECORD + 1)
    elif data.startswith(LZ4):
        plain = lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=MAX_RECORD + 1)
    else:
        return data
    if len(plain) > MAX_RECORD:
        raise ValueError(f"a compressed message of more than {MAX_RECORD} bytes")
    return plain


def _reason(error: Exception) -> str:
    return sanitize(str(error)) or type(error).__name__


def _intact(file: Path) -> str:
    """How far a damaged file can be read: the last intact iteration of each topic."""
    counts = Counter[str]()
    with suppress(*DAMAGE), open_mcap(file) as stream:
        for found in McapScan(stream, lambda _: True).messages():
            counts[found.channel.topic] += 1
    intact = [f"topic {sanitize(topic)}: iteration {counts[topic]}" for topic in sorted(counts)]
    return "intact up to " + (truncate(", ".join(intact), MAX_LIST) or "no iteration of any topic")
