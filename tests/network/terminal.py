"""A command in a terminal of its own, as a person has it: keys go in, a screen comes out."""

import os
import pty
import re
import signal
import subprocess
import threading
import time
from collections.abc import Sequence
from contextlib import suppress

STEERING = re.compile(r"\x1b\[[0-9;?]*[A-Za-z]")


class Terminal:
    """A command whose standard input and error are a pseudo-terminal."""

    def __init__(self, command: Sequence[str], environment: dict[str, str]) -> None:
        self._screen, other = pty.openpty()
        self.process = subprocess.Popen(
            command,
            stdin=other,
            stdout=subprocess.PIPE,
            stderr=other,
            env={**os.environ, **environment, "TERM": "xterm", "COLUMNS": "120", "LINES": "30"},
            start_new_session=True,
        )
        os.close(other)
        self._raw = b""
        self._reader = threading.Thread(target=self._read, daemon=True)  # a full terminal would stop the command
        self._reader.start()

    def _read(self) -> None:
        with suppress(OSError):  # raised when the command has ended
            while data := os.read(self._screen, 65536):
                self._raw += data

    @property
    def text(self) -> str:
        """All that was shown so far, without what steers the cursor."""
        return STEERING.sub("", self._raw.decode(errors="replace"))

    def press(self, keys: str) -> None:
        os.write(self._screen, keys.encode())

    def until(self, words: str, since: int = 0, timeout: float = 20.0) -> int:
        """Wait until words are shown; how much had been shown by then."""
        deadline = time.monotonic() + timeout
        while words not in self.text[since:]:
            assert time.monotonic() < deadline, f"{words!r} is not shown: {self.text[since:][-2000:]}"
            assert self.process.poll() is None or words in self.text[since:], self.text[-2000:]
            time.sleep(0.02)
        return self.text.index(words, since) + len(words)

    def close(self) -> None:
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGKILL)
        self.process.communicate()
        self._reader.join(5)
        os.close(self._screen)
