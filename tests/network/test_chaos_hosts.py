"""Two hosts with half of a run each: whatever happens to them, their cables and clocks, every bit is there."""

import random
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import pytest
from chaos_of_hosts import SHARES, Chaos, deck
from halves import settings, two_halves
from namespaces import obstacle
from stepped_clock import clock_obstacle

from mabirds_msgs_py.environment import FASTDDS_PROFILE

OBSTACLE = obstacle() or clock_obstacle()
pytestmark = pytest.mark.skipif(OBSTACLE is not None, reason=f"no virtual hosts: {OBSTACLE}")

Survive = Callable[..., Counter[str]]


@pytest.fixture
def survive(
    make_experiment: Callable[..., Path],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> Survive:
    """A function that applies faults to as many runs as it takes and compares each with the undisturbed reference."""
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(FASTDDS_PROFILE))  # other tests keep to this host

    def run(faults: int, seed: int, iterations: int, seconds: float = float("inf")) -> Counter[str]:
        rng, done, begin = random.Random(seed), Counter[str](), time.monotonic()
        file, left = make_experiment(**settings(iterations)), deck(random.Random(seed), faults)
        runs = 0
        while left and time.monotonic() - begin < seconds:
            runs += 1
            (tmp_path / f"run_{runs}").mkdir()
            with two_halves(tmp_path / f"run_{runs}", hz=20.0) as halves:
                chaos = Chaos(halves, file, rng)
                chaos.run(left, last=iterations - 15)
                halves.assert_all_whole(file)
            done += chaos.done
            with capsys.disabled():
                print(  # noqa: T201 - for the log of CI
                    f"\nrun {runs}: {chaos.done.total()} faults, longest pause {chaos.longest_pause:.1f} s; in all"
                    f" {done.total()} in {time.monotonic() - begin:.0f} s, {dict(done)}",
                    end="",
                )
        return done

    return run


def test_every_bit_survives_chaos_of_hosts(survive: Survive) -> None:
    done = survive(faults=200, seed=1, iterations=200)
    assert done.total() == 200
    assert done.keys() == SHARES.keys()


@pytest.mark.slow
@pytest.mark.timeout(3000)
def test_every_bit_survives_more_chaos_of_hosts(survive: Survive) -> None:
    done = survive(faults=2000, seed=2, iterations=200, seconds=2400.0)
    assert done.total() == 2000
