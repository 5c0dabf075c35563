"""Keys pressed in a terminal, one at a time, without waiting for a line."""

import os
import select
import sys
import termios
import tty
from collections.abc import Iterator
from typing import Any, Self

NAMES = {b"\x1b[A": "up", b"\x1b[B": "down", b"\x1b[C": "right", b"\x1b[D": "left", b" ": "space"}
"""What terminals send for keys that are no letters; the arrows come as three bytes."""

ARROW = 3


class Keyboard:
    """The keys of standard input, as a context manager; none where it is no terminal.

    Ctrl-C stays what it is.
    """

    def __init__(self) -> None:
        self._file: int | None = sys.stdin.fileno() if sys.stdin.isatty() else None
        self._before: list[Any] = []
        self._bytes = b""

    @property
    def is_there(self) -> bool:
        """Is there a terminal?"""
        return self._file is not None

    def __enter__(self) -> Self:
        if self._file is not None:
            self._before = termios.tcgetattr(self._file)
            tty.setcbreak(self._file)
        return self

    def __exit__(self, *_: object) -> None:
        if self._file is not None:
            termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)

    def pressed(self) -> Iterator[str]:
        """Names of the keys that were pressed since the last call; a letter is its own name."""
        while self._file is not None and select.select([self._file], [], [], 0)[0]:
            if not (data := os.read(self._file, 256)):
                self._file = None
            self._bytes += data
        while self._bytes and not self._is_begun:
            size = ARROW if self._bytes.startswith(b"\x1b[") else 1
            key, self._bytes = self._bytes[:size], self._bytes[size:]
            yield NAMES.get(key, key.decode("ascii", "replace"))

    @property
    def _is_begun(self) -> bool:
        """Is there the beginning of an arrow, whose end is still to come?"""
        return self._bytes in (b"\x1b", b"\x1b[")
