"""A bag of 100,000 demonstrations: ready soon, flat memory, and each costs the same whatever the chunks are."""

import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Self

import pytest
from bag_variants import LZ4, UNCHUNKED, ZSTD, Entry, Layout, write_mcap

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag

READY = 2.0
"""Seconds of processor time."""

EACH = 1e-3
"""Seconds a demonstration."""

MEMORY = 40 * 2**20
"""Bytes that 100,000 demonstrations may take more than 1,000 do: 28 of each are where it stands."""

LAYOUTS: dict[str, Layout] = {
    "chunks of 768 KiB": ZSTD._replace(options={**ZSTD.options, "chunk_size": 768 * 1024}),
    "unchunked": UNCHUNKED,
    "one chunk": ZSTD._replace(options={**ZSTD.options, "chunk_size": 2**30}),
    "a chunk each": LZ4._replace(options={**LZ4.options, "chunk_size": 1}),
}
USUAL = "chunks of 768 KiB"
CASES = [
    pytest.param(layout, step, id=f"{layout}{'' if step else ', equal times'}", marks=() if quick else pytest.mark.slow)
    for layout, step, quick in [
        (USUAL, 0, True),
        ("unchunked", 10**9, True),
        *((layout, step, False) for layout in LAYOUTS for step in (0, 10**9)),
    ]
]

MEASURE = """
import resource, sys
from pathlib import Path
from mabirds_msgs_py.environment import prepare_environment
prepare_environment()
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag
experiment = load_experiment(Path(sys.argv[1]))
with DemonstrationBag(Path(sys.argv[2]), build_game(experiment), experiment.learners) as bag:
    for iteration in range(1, bag.count("learner_1") + 1, 97):
        bag.message("learner_1", iteration)
print(1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.fixture(scope="module")
def file(make_shared_experiment: Callable[..., Path]) -> Path:
    return make_shared_experiment()


@pytest.fixture(scope="module")
def experiment(file: Path) -> Experiment:
    return load_experiment(file)


def many(experiment: Experiment, count: int, time_step: int = 10**9) -> list[Entry]:
    """The experiment's demonstrations again and again, numbered on."""
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        few = {name: [bag.message(name, n + 1) for n in range(bag.count(name))] for name in experiment.learners}
    return [
        _Numbered(f"/{name}/demonstration", n * time_step, few[name][n % 6], n + 1)
        for n in range(count // 2)
        for name in experiment.learners
    ]


class _Numbered(Entry):
    """An entry that numbers its message when it is written: all share few messages."""

    def __new__(cls, topic: str, time: int, message: object, number: int) -> Self:
        made = super().__new__(cls, topic, time, message)
        made.number = number
        return made

    @property
    def data(self) -> bytes:
        self.message.iteration = self.number
        return super().data


@pytest.mark.parametrize(("layout", "step"), CASES)
def test_it_is_ready_soon_and_each_costs_the_same(
    experiment: Experiment, tmp_path: Path, layout: str, step: int
) -> None:
    write_mcap(tmp_path / "bag.mcap", many(experiment, 100_000, step), LAYOUTS[layout])
    start = time.process_time()
    with DemonstrationBag(tmp_path / "bag.mcap", build_game(experiment), experiment.learners) as bag:
        ready = time.process_time()
        for iteration in range(1, 50_001, 25):
            assert bag.message("learner_1", iteration).iteration == iteration
        each = (time.process_time() - ready) / 2000
    assert ready - start < READY
    assert each < EACH


def test_beside_dense_topics_each_costs_the_same(experiment: Experiment, tmp_path: Path) -> None:
    layout = ZSTD._replace(options={**ZSTD.options, "chunk_size": 4 * 2**20})
    write_mcap(tmp_path / "bag.mcap", many(experiment, 2000), layout, others=70_000)
    with DemonstrationBag(tmp_path / "bag.mcap", build_game(experiment), experiment.learners) as bag:
        start = time.process_time()
        for iteration in range(1, 1001):
            bag.message("learner_2", iteration)
        assert (time.process_time() - start) / 1000 < EACH


@pytest.mark.parametrize(
    "layout", [USUAL, *(pytest.param(name, marks=pytest.mark.slow) for name in LAYOUTS if name != USUAL)]
)
def test_memory_stays_flat(file: Path, experiment: Experiment, tmp_path: Path, layout: str) -> None:
    used = []
    for count in (1000, 100_000):
        bag = tmp_path / f"{count}.mcap"
        write_mcap(bag, many(experiment, count), LAYOUTS[layout])
        command = [sys.executable, "-c", MEASURE, str(file), str(bag)]
        done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
        used.append(int(done.stdout))
    assert used[1] - used[0] < MEMORY
