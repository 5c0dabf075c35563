"""Faults of hosts, of all that runs on them, of the cables between them and of their clocks, drawn at random."""

import random
import signal
import time
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import psutil
from halves import HALVES, Halves
from stepped_clock import SteppedClock

SHARES = {
    "clock": 55,
    "stop node": 34,
    "cut link": 34,
    "suspend supervisor": 26,
    "suspend half": 20,
    "partition": 17,
    "kill node": 6,
    "kill supervisor": 3,
    "kill half": 3,
    "address": 2,
}
"""How many faults of 200 are of which kind; the rarest cost the most seconds."""

STEPS = (-86400.0, -3600.0, -30.0, -0.5, 0.5, 30.0, 3600.0, 86400.0)
"""Seconds by which a clock is set."""

SHORT, LONG, RARELY = 0.4, 4.0, 1 / 16
"""Seconds at most for which something is suspended or cut; the long time, beyond the lease of liveliness, rarely."""

GETTING_ON, STANDING = 0.1, 0.3
"""Seconds between two faults where the run has got on since the last one, and where it has not."""

BREATH, PATIENCE = 15.0, 75.0
"""Seconds without a new checkpoint after which a run is left in peace until it gets on, and after which it hangs."""


def deck(rng: random.Random, count: int) -> list[str]:
    """So many faults, of every kind its share, in any order."""
    total = sum(SHARES.values())
    kinds = [kind for kind, share in SHARES.items() for _ in range(-(-share * count // total))]
    rng.shuffle(kinds)
    return kinds[:count]


class Chaos:
    """Harms a run until no faults are left or it nears its end; ``done`` counts them by kind."""

    def __init__(self, halves: Halves, file: Path, rng: random.Random) -> None:
        self._halves, self._file, self._rng = halves, file, rng
        self._clocks = {host: SteppedClock(halves.directory, host) for host in HALVES}
        self._ahead = dict.fromkeys(HALVES, 0.0)
        self._got_on = time.monotonic()
        self._undo: list[tuple[float, Callable[[], None]]] = []
        self.done = Counter[str]()
        self.longest_pause, self._began, self._log = 0.0, time.monotonic(), list[str]()
        halves.environments = {host: clock.environment for host, clock in self._clocks.items()}

    def run(self, faults: list[str], last: int) -> None:
        """Start, and take faults from the list up to iteration ``last``; then undo what is left and wait."""
        for host in HALVES:
            self._start(host)
        harmed_at, due = 0, time.monotonic() + 1.0
        for newest in self._moments():
            if not faults or newest >= last:
                break
            now, gets_on = time.monotonic(), newest > harmed_at
            if now - self._got_on < BREATH and now >= due - (STANDING - GETTING_ON if gets_on else 0.0):
                self._harm(faults.pop())
                harmed_at, due = self._newest(), time.monotonic() + STANDING
        self._undo_until(float("inf"))
        for _ in self._moments():
            if all(process.poll() is not None for process in self._halves.running.values()):
                break

    def _start(self, host: str) -> None:
        """The command of this host; one of two times where it can by --resume."""
        if self._halves.newest(host) and self._rng.random() < 1 / 2:
            self._halves.start(host, "--resume", self._halves.run_directory(host), "--restarts", 1000)
        else:
            self._halves.start_part(host, self._file, "--restarts", "1000")

    def _newest(self) -> int:
        return max(map(self._halves.newest, HALVES))

    def _moments(self) -> Iterator[int]:
        """The newest iteration, over and over, while the run gets on and nobody ends but as asked."""
        newest, self._got_on = self._newest(), time.monotonic()
        while True:
            yield newest
            time.sleep(0.02)
            self._undo_until(time.monotonic())
            if (found := self._newest()) > newest:
                newest, self._got_on = found, time.monotonic()
            pause = time.monotonic() - self._got_on
            self.longest_pause = max(self.longest_pause, pause)
            ended = {host: process.returncode for host, process in self._halves.running.items() if process.poll()}
            assert not ended, self._explained(f"ended by themselves: {ended}")
            assert pause < PATIENCE, self._explained(f"hangs at iteration {newest}")

    def _explained(self, words: str) -> str:
        return self._halves.explained("\n".join([words, *self._log[-40:]]))

    def _undo_until(self, now: float) -> None:
        for _, action in [entry for entry in self._undo if entry[0] <= now]:
            with suppress(psutil.NoSuchProcess):
                action()
        self._undo = [entry for entry in self._undo if entry[0] > now]

    def _harm(self, kind: str) -> None:
        host = self._rng.choice(list(HALVES))
        getattr(self, f"_{kind.replace(' ', '_')}")(host)
        self.done[kind] += 1
        self._log.append(f"{time.monotonic() - self._began:.1f} s, iteration {self._newest()}: {kind} of {host}")

    def _for_a_while(self, undo: Callable[[], None]) -> None:
        seconds = LONG if self._rng.random() < RARELY else self._rng.uniform(0.05, SHORT)
        self._undo.append((time.monotonic() + seconds, undo))

    def _supervisor(self, host: str) -> psutil.Process:
        return psutil.Process(self._halves.running[host].pid)

    def _clock(self, host: str) -> None:
        self._ahead[host] += self._rng.choice(STEPS)
        self._clocks[host].set(self._ahead[host])

    def _cut_link(self, host: str) -> None:
        self._halves.lan.cut(host)
        self._for_a_while(lambda: self._halves.lan.plug(host))

    def _partition(self, host: str) -> None:
        self._halves.lan.partition([host])
        self._for_a_while(self._halves.lan.rejoin)

    def _address(self, host: str) -> None:
        self._halves.lan.readdress(host)

    def _stop_node(self, host: str) -> None:
        self._suspend(self._node(host))

    def _suspend_supervisor(self, host: str) -> None:
        self._suspend([self._supervisor(host)])

    def _suspend_half(self, host: str) -> None:
        self._suspend([self._supervisor(host), *self._supervisor(host).children()])

    def _suspend(self, victims: list[psutil.Process]) -> None:
        for victim in victims:
            with suppress(psutil.NoSuchProcess):
                victim.suspend()
                self._for_a_while(victim.resume)

    def _kill_node(self, host: str) -> None:
        for victim in self._node(host):
            with suppress(psutil.NoSuchProcess):
                victim.kill()

    def _node(self, host: str) -> list[psutil.Process]:
        """One of them, if there are any just now."""
        children = self._supervisor(host).children()
        return [self._rng.choice(children)] if children else []

    def _kill_supervisor(self, host: str) -> None:
        process = self._halves.running[host]
        process.send_signal(signal.SIGKILL)
        process.wait()
        self._start(host)

    def _kill_half(self, host: str) -> None:
        children = self._supervisor(host).children()
        for victim in self._rng.sample(children, len(children)):
            with suppress(psutil.NoSuchProcess):
                victim.kill()
        self._kill_supervisor(host)
