"""The supervisor is killed and gone on with, suspended, and its nodes killed, at random; every bit stays the same."""

import random
import signal
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import psutil
import pytest
from identity import assert_same_histories

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.run.stored_run import load_run
from mabirds_learner.checkpoint import newest_of_anybody

MABIRDS = str(Path(sys.executable).with_name("mabirds"))
HARMS = ("kill supervisor", "suspend supervisor", "kill node", "kill node", "stop node")
PATIENCE = 60.0
"""Seconds without a new checkpoint after which a run hangs."""


class Life:
    """One run with all its lives."""

    def __init__(self, file: Path, out: Path, rng: random.Random) -> None:
        self._file, self._out, self._rng, self.done = file, out, rng, Counter[str]()
        self._process = self._start(str(file), "--hz", "30", "--restarts", "1000", "--out", str(out))

    def _start(self, *arguments: str) -> "subprocess.Popen[str]":
        with (self._out.parent / "output.txt").open("a", encoding="utf-8") as output:
            return subprocess.Popen([MABIRDS, "run", *arguments], stdout=output, stderr=output, text=True)

    @property
    def directory(self) -> Path:
        return (self._out / "latest").resolve()

    @property
    def newest(self) -> int:
        return max(
            (found[0] for found in map(newest_of_anybody, self.directory.glob("checkpoints/*")) if found), default=0
        )

    def wait_beyond(self, iteration: int) -> bool:
        """Until a learner has gone beyond an iteration; False where the run has ended before."""
        deadline = time.monotonic() + PATIENCE
        while self._process.poll() is None:
            if (self._out / "latest").exists() and self.newest > iteration:
                return True
            assert time.monotonic() < deadline, f"hangs at iteration {self.newest}"
            time.sleep(0.02)
        return False

    def harm(self) -> None:
        what = self._rng.choice(HARMS)
        children = psutil.Process(self._process.pid).children()
        if what == "kill supervisor":
            self._process.kill()
            self._process.wait()
            psutil.wait_procs(children, timeout=20)
            self._process = self._start("--resume", str(self.directory), "--restarts", "1000")
        elif what == "suspend supervisor":
            self._process.send_signal(signal.SIGSTOP)
            time.sleep(self._rng.uniform(0.1, 1.5))
            self._process.send_signal(signal.SIGCONT)
        elif children:
            victim = self._rng.choice(children)
            victim.send_signal(signal.SIGKILL if what == "kill node" else signal.SIGSTOP)
            if what == "stop node":
                time.sleep(self._rng.uniform(0.1, 1.0))
                if victim.is_running():
                    victim.resume()
        self.done[what] += 1

    def end(self, timeout: float = 120.0) -> int:
        return self._process.wait(timeout)

    def stop(self) -> None:
        self._process.kill()
        self._process.wait()


def survive(file: Path, directory: Path, seed: int, faults: int, every: int) -> Counter[str]:
    """One run with a fault after every so many iterations; returns what was done how often."""
    life = Life(file, directory / "runs", random.Random(seed))
    try:
        for _ in range(faults):
            if not life.wait_beyond(life.newest + every if life.done else 2):
                break
            life.harm()
        assert life.end() == 0, (directory / "output.txt").read_text(encoding="utf-8")
    finally:
        life.stop()
    run = load_run(life.directory)
    assert run.summary()["complete"]
    with run.open_history() as kept:
        assert_same_histories(kept.without_gap(), simulate_from_bag(run.experiment))
    return life.done


def test_the_result_survives_chaos_of_the_supervisor(make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    done = survive(make_experiment(learners=2, iterations=100), tmp_path, seed=1, faults=8, every=4)
    assert done.total() >= 6
    assert done["kill supervisor"] >= 1


@pytest.mark.slow
@pytest.mark.timeout(1200)
@pytest.mark.parametrize("seed", range(5))
def test_the_result_survives_more_of_it(make_experiment: Callable[..., Path], tmp_path: Path, seed: int) -> None:
    done = survive(make_experiment(learners=3, iterations=400), tmp_path, seed=seed, faults=40, every=6)
    print(dict(done))  # noqa: T201 - for those who wonder what happened
    assert done.total() >= 30
