"""Addresses of this host: a participant keeps those that were there when it was made."""

import array
import fcntl
import socket
import struct
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SIOCGIFCONF, SIOCGIFFLAGS = 0x8912, 0x8913

RUNNING = 0x40
"""IFF_RUNNING: the link is up."""

ENTRY, MAX_ENTRIES = 40, 256
"""Bytes of struct ifreq on 64-bit Linux, and how many interfaces are looked at."""

PERIOD, LASTING = 1.0, 3.0
"""Seconds between two looks, and for which a change must last."""

PERIOD_AT_FIRST = 0.02
"""Seconds between two looks while a participant is made."""


def own_addresses() -> frozenset[str]:
    """Interfaces whose link is up, with their IPv4 addresses; nothing on systems other than Linux."""
    if sys.platform != "linux":
        return frozenset()
    room = array.array("B", bytes(ENTRY * MAX_ENTRIES))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        request = struct.pack("iL", len(room), room.buffer_info()[0])
        (used,) = struct.unpack_from("i", fcntl.ioctl(probe, SIOCGIFCONF, request))
        entries = [room.tobytes()[place : place + ENTRY] for place in range(0, used, ENTRY)]
        return frozenset(_described(entry) for entry in entries if _is_running(probe, entry))


def _is_running(probe: socket.socket, entry: bytes) -> bool:
    answer = fcntl.ioctl(probe, SIOCGIFFLAGS, entry[:16].ljust(ENTRY, b"\0"))
    return bool(struct.unpack_from("H", answer, 16)[0] & RUNNING)


def _described(entry: bytes) -> str:
    name = entry[:16].split(b"\0")[0].decode(errors="replace")
    return f"{name} {socket.inet_ntoa(entry[20:24])}"


class AddressWatch:
    """Notices that this host has addresses that it had not when a process began.

    An address that is gone is no change: with the link it comes back, and the participant with it.

    Parameters
    ----------
    look : Callable[[], frozenset[str]], optional
        Takes a look.
    clock : Callable[[], float], optional
        Seconds that only grow.
    """

    def __init__(
        self, look: Callable[[], frozenset[str]] = own_addresses, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._look, self._clock = look, clock
        self._at_first = look()
        self._looked_at, self._changed_at = clock(), 0.0
        self._now = self._at_first

    @contextmanager
    def while_made(self) -> Iterator[None]:
        """Look all the time while a participant is made: it may lack what was away for a moment, and never gets it.

        Such a process hears those of its own host, and nobody else.

        Yields
        ------
        None
            Nothing.
        """
        over = threading.Event()

        def look() -> None:
            while not over.is_set():
                self._at_first &= self._look()
                time.sleep(PERIOD_AT_FIRST)

        thread = threading.Thread(target=look, daemon=True, name="address watch")
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()
            self._now = self._look()
            self._at_first &= self._now

    def has_new(self) -> bool:
        """Are there addresses by which this process may not be heard, and hears nobody, be they lasting or not?"""
        return bool(self._look() - self._at_first)

    def changed(self) -> str | None:
        """In words how they have changed, once new ones have stayed for a while; looks once a second at most."""
        now = self._clock()
        if now - self._looked_at >= PERIOD:
            self._looked_at, found = now, self._look()
            if found != self._now:
                self._now, self._changed_at = found, now
        gone, new = self._at_first - self._now, self._now - self._at_first
        if not new or now - self._changed_at < LASTING:
            return None
        words = (", ".join(sorted(some)) or "none" for some in (gone, new))
        return "addresses of this host have changed (gone: {}; new: {})".format(*words)
