"""The recording of a run: bags one after the other, without which learning goes on where they cannot be written."""

import shutil
import time
from itertools import chain, count
from pathlib import Path
from typing import Any, Self

from mabirds_msgs_py.bag_repair import repair
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.errors import BagError

MESSAGES = 100_000
"""Messages of a bag before the next is begun: a writer remembers where each piece of its file is."""

AGAIN = 10.0
"""Seconds after which a recording that failed is tried again, and between two looks whether its file is still there."""

METADATA = "metadata.yaml"


class Recording:
    """Bags ``bag``, ``bag_2`` and so on in a run directory, as a context manager.

    Those that a killed process left without their ends are repaired first. ``news``: what people must hear.
    """

    def __init__(self, directory: Path) -> None:
        self._directory, self.news = directory, list[str]()
        for bag in directory.glob("bag*"):
            if not (bag / METADATA).exists():
                self._repair(bag)
        self._written, self._looked_at, self._failed_at = 0, time.monotonic(), 0.0
        self._bag: BagWriter | None = None
        self._place = self._next_place()

    def _repair(self, bag: Path) -> None:
        if not any(file.stat().st_size for file in bag.glob("*.mcap")):
            shutil.rmtree(bag)  # killed before the first byte was written
            return
        target = bag.with_name(f"{bag.name}.repaired")
        shutil.rmtree(target, ignore_errors=True)
        try:
            repair(bag, target)
        except BagError as error:
            self.news.append(f"{bag}: could not be repaired ({error})")
            return
        shutil.rmtree(bag)
        target.rename(bag)

    def _next_place(self) -> Path:
        names = chain(["bag"], (f"bag_{n}" for n in count(2)))
        return next(place for name in names if not (place := self._directory / name).exists())

    def __enter__(self) -> Self:
        self._write_or_fail(self._open)
        return self

    def __exit__(self, *_: object) -> None:
        """Finish the bag, whatever happened."""
        self._write_or_fail(self._close)

    def write(self, topic: str, message: Any, stamp: int, data: bytes | None = None) -> None:
        """Append a message, if that is possible just now; ``data``: as of ``BagWriter.write``."""
        if self._bag is None and time.monotonic() - self._failed_at < AGAIN:
            return
        self._write_or_fail(lambda: self._append(topic, message, stamp, data))

    def _append(self, topic: str, message: Any, stamp: int, data: bytes | None) -> None:
        if self._written >= MESSAGES:
            self._close()
        bag = self._open()
        if time.monotonic() - self._looked_at > AGAIN:
            self._looked_at = time.monotonic()
            self._require_file()
        bag.write(topic, message, stamp, data)
        self._written += 1

    def _open(self) -> BagWriter:
        if self._bag is None:
            self._place, self._written = self._next_place(), 0
            self._bag = BagWriter(self._place, keep=True)
        return self._bag

    def _require_file(self) -> None:
        if not any(self._place.glob("*.mcap")):
            raise FileNotFoundError(2, "its file was removed", str(self._place))

    def _close(self) -> None:
        if self._bag:
            self._bag.close()
            self._bag = None

    def _write_or_fail(self, attempt: Any) -> None:
        try:
            attempt()
        except OSError as error:
            if self._bag:
                self._bag.abandon()
            self._bag, self._failed_at = None, time.monotonic()
            self.news.append(
                f"{self._place}: the recording fails ({error.strerror}); learning goes on without it, and a new one is"
                f" tried every {AGAIN:g} s"
            )
