"""Records on disk, as logs and journals have them: an iteration, some bytes, and a checksum of both.

A file begins with a header that says what it is and whose. The checksum covers the header, too, so that a record of
another file is none here. One that was never written, or only in part, is seen to be missing.
"""

import hashlib
import os
import struct
from typing import NamedTuple

HEADER = 512
"""Bytes at the beginning of a file, which say what it holds."""

MARK = b"mabirds\x01"
"""Every record begins with it, so that records behind a damaged one are found."""

HEAD = struct.Struct("<8sQQ32s")
"""Of a record: mark, iteration, bytes of content, SHA-256."""

_SIZES = struct.Struct("<QQ")

MOST_AT_ONCE = 2**30
"""Bytes that are handed to the system in one call."""

Buffer = bytes | memoryview


class Record(NamedTuple):
    """One record.

    Attributes
    ----------
    iteration : int
        n.
    content : Buffer
        Its bytes, a view where it was found in one.
    """

    iteration: int
    content: Buffer

    @property
    def size(self) -> int:
        """Bytes that it takes in its file."""
        return HEAD.size + len(self.content)


class Format:
    """Of the records of one file.

    Parameters
    ----------
    words : str
        What the file is and whose, in at most 512 bytes.
    """

    def __init__(self, words: str) -> None:
        self.header = words.encode().ljust(HEADER, b"\0")

    def pack(self, iteration: int, content: bytes) -> bytes:
        """Write a record.

        Parameters
        ----------
        iteration : int
            n.
        content : bytes
            Any.

        Returns
        -------
        bytes
            As they are in the file.
        """
        return HEAD.pack(MARK, iteration, len(content), self._checksum(iteration, content)) + content

    def unpack(self, buffer: Buffer, offset: int = 0) -> Record | None:
        """Read a record.

        Parameters
        ----------
        buffer : Buffer
            Of the file.
        offset : int, optional
            Where the record begins in it.

        Returns
        -------
        Record or None
            None where there is none, or none that is whole.
        """
        start = offset + HEAD.size
        if len(buffer) < start:
            return None
        mark, iteration, size, checksum = HEAD.unpack_from(buffer, offset)
        if mark != MARK or size > len(buffer) - start:
            return None
        content = buffer[start : start + size]
        return Record(iteration, content) if checksum == self._checksum(iteration, content) else None

    def _checksum(self, iteration: int, content: Buffer) -> bytes:
        total = hashlib.sha256(self.header)
        total.update(_SIZES.pack(iteration, len(content)))
        total.update(content)
        return total.digest()


def words_of(header: bytes) -> str:
    """What a header says.

    Parameters
    ----------
    header : bytes
        The first of a file.

    Returns
    -------
    str
        Its words, whatever the bytes are.
    """
    return header[:HEADER].rstrip(b"\0").decode(errors="replace").strip()


def write_all(descriptor: int, content: Buffer, offset: int) -> None:
    """Write all bytes at a place of a file; one call of the system may write fewer.

    Parameters
    ----------
    descriptor : int
        Of the file.
    content : Buffer
        What is written.
    offset : int
        Where.

    Raises
    ------
    OSError
        It cannot be written.
    """
    rest = memoryview(content)
    while rest:
        written = os.pwrite(descriptor, rest[:MOST_AT_ONCE], offset)
        rest, offset = rest[written:], offset + written
