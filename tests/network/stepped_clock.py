"""System clocks that are set while processes run, each host's its own.

The clock of a container is that of its machine, and a time namespace has steady clocks only. So processes are started
with a small library that answers for the system's clock (``stepped_clock.c``); it takes a C compiler.
"""

import os
import shutil
import subprocess
from pathlib import Path

SOURCE = Path(__file__).with_name("stepped_clock.c")
SECOND = 10**9


def clock_obstacle() -> str | None:
    """Why no clock can be stepped here; None where it can."""
    return None if shutil.which("cc") else "cc: not found; install a C compiler (on Debian and Ubuntu: gcc)"


def compile_c(*arguments: str) -> None:
    command = ["cc", *arguments]
    subprocess.run(command, check=True)


class SteppedClock:
    """The system clock of all processes with ``environment``; ``directory``: for its files."""

    def __init__(self, directory: Path, name: str) -> None:
        library, self._file = directory / "stepped_clock.so", directory / f"{name}.clock"
        if not library.exists():
            compile_c("-O2", "-Wall", "-Werror", "-shared", "-fPIC", "-o", str(library), str(SOURCE))
        self._file.write_bytes(bytes(8))
        self.environment = {"LD_PRELOAD": str(library), "MABIRDS_CLOCK_FILE": str(self._file)}

    def set(self, seconds: float) -> None:
        """Let it be so many seconds ahead of the machine's clock, at once."""
        with self._file.open("r+b") as stream:
            os.pwrite(stream.fileno(), int(seconds * SECOND).to_bytes(8, "little", signed=True), 0)
