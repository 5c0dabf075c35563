"""A journal: records one behind the other in a file with room for more, each on the disk before ``append`` returns.

One write and one fdatasync a record: the room was given to the file before, so that nothing but the record changes. A
process that is killed leaves a torn record at the end at most. A full journal is written anew beside, with its newest
records, and takes its name once it is on the disk: whenever the power fails, the old one is there or the new one.
"""

import mmap
import os
from collections import deque
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mabirds_learner.records import HEADER, MARK, Format, Record, words_of, write_all

UNFINISHED = ".unfinished"
"""Behind the name of a journal that is being written anew."""

ROOM = 2**20
"""Bytes of a journal at least."""

RECORDS = 16
"""Of the newest one's size for which a new journal has room at least."""

ZEROED = 2**22
"""Bytes of the room that are written beforehand: what is only reserved changes more than itself when it is written."""

COMPLETE = 3
"""How many of the newest records stay when a journal is written anew: where to go on from, and two in reserve."""


class Journal:
    """The journal of one owner; to be closed.

    Parameters
    ----------
    file : Path
        Is made with the first record; its directory is there.
    words : str
        What it is, and whose.
    """

    def __init__(self, file: Path, words: str) -> None:
        self.file, self._format = file, Format(words)
        self._unfinished = file.with_name(f"{file.name}{UNFINISHED}")
        self._newest: deque[bytes] = deque(maxlen=COMPLETE - 1)
        self._descriptor, self._end, self._size = -1, 0, 0
        self._unfinished.unlink(missing_ok=True)

    def go_on_behind(self, records: Sequence[Record]) -> None:
        """The next record begins the file anew, behind the newest of those that were read.

        Parameters
        ----------
        records : Sequence[Record]
            In their order.
        """
        self._newest.extend(self._format.pack(n, bytes(content)) for n, content in records[1 - COMPLETE :])
        self._size = 0

    def has_room(self, size: int) -> bool:
        """Will a record be written behind the others, and the file not anew?

        Parameters
        ----------
        size : int
            Of its content.

        Returns
        -------
        bool
            It fits.
        """
        return self._end + Record(0, bytes(0)).size + size <= self._size

    def append(self, iteration: int, content: bytes) -> None:
        """Write a record, on the disk when this returns.

        Parameters
        ----------
        iteration : int
            n.
        content : bytes
            Any.

        Raises
        ------
        OSError
            It cannot be written. All that was written before is still there.
        """
        record = self._format.pack(iteration, content)
        try:
            if self.has_room(len(content)):
                write_all(self._descriptor, record, self._end)
                os.fdatasync(self._descriptor)
                self._end += len(record)
            else:
                self._begin_anew(record)
        except OSError:
            self._size = 0  # what is left of a file that could not be synchronised is not known: it is not used again
            raise
        self._newest.append(record)

    def _begin_anew(self, record: bytes) -> None:
        start = b"".join([self._format.header, *self._newest, record])
        size = max(ROOM, len(start) + RECORDS * len(record))
        descriptor = os.open(self._unfinished, os.O_RDWR | os.O_CREAT | os.O_TRUNC, 0o644)
        try:
            _fill(descriptor, start, size)
            self._unfinished.replace(self.file)
            synchronise_directory(self.file.parent)
        except OSError:
            os.close(descriptor)
            raise
        self.close()
        self._descriptor, self._end, self._size = descriptor, len(start), size

    def close(self) -> None:
        """Close the file; nothing can be written afterwards."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
        self._descriptor, self._size = -1, 0


def _fill(descriptor: int, start: bytes, size: int) -> None:
    """What a new file begins with, and room behind it, on the disk."""
    os.posix_fallocate(descriptor, 0, size)
    write_all(descriptor, start, 0)
    write_all(descriptor, bytes(min(ZEROED, size - len(start))), len(start))
    os.fdatasync(descriptor)


def synchronise_directory(directory: Path) -> None:
    """See to it that names of files are on the disk.

    Parameters
    ----------
    directory : Path
        Of the files.

    Raises
    ------
    OSError
        It cannot be synchronised.
    """
    descriptor = os.open(directory, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


class Found(NamedTuple):
    """What a journal holds.

    Attributes
    ----------
    header : str
        Words that say whose it is.
    records : list[Record]
        That are whole, in their order.
    damaged : list[str]
        What else there is, in words.
    """

    header: str
    records: list[Record]
    damaged: list[str]


def read_journal(file: Path, words: str) -> Found:
    """Read a journal, which its owner may be writing to.

    Parameters
    ----------
    file : Path
        The journal.
    words : str
        What it must be, and whose; records of others are damaged ones.

    Returns
    -------
    Found
        All of it.

    Raises
    ------
    OSError
        It cannot be read.
    """
    with file.open("rb") as stream:
        if not os.fstat(stream.fileno()).st_size:
            return Found("", [], [])
        content = mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ)
    found = Found(words_of(content[:HEADER]), [], [])
    _look_through(memoryview(content), content, Format(words), found)
    return found


def _look_through(content: memoryview, bytes_of: mmap.mmap, layout: Format, found: Found) -> None:
    """Records wherever they are: behind a damaged one, the next mark shows where to go on."""
    offset = HEADER
    while offset < len(content):
        record = layout.unpack(content, offset)
        if record:
            found.records.append(record)
            offset += record.size
        else:
            following = _next(content, bytes_of, layout, offset)
            if np.frombuffer(content[offset:following], dtype=np.uint8).any():
                found.damaged.append(_words(found.records, offset, following, len(content)))
            offset = following


def _next(content: memoryview, bytes_of: mmap.mmap, layout: Format, offset: int) -> int:
    """Where the next whole record begins, or the end."""
    while (offset := bytes_of.find(MARK, offset + 1)) >= 0:
        if layout.unpack(content, offset):
            return offset
    return len(content)


def _words(before: Sequence[Record], offset: int, following: int, end: int) -> str:
    after = f"behind iteration {before[-1].iteration}" if before else "at the beginning"
    what = "no whole record" if following < end else "the last record is not whole"
    return f"{what} {after} (byte {offset})"
