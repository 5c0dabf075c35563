"""Learners and the player are killed, stopped and started again at random; every bit of the result stays the same."""

import os
import random
import signal
import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeGuard

import pytest
from identity import assert_same_histories

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.evaluate.results import audit
from mabirds_bringup.run.network import Network
from mabirds_bringup.run.processes import PLAYER, NodeProcess
from mabirds_bringup.run.supervisor import Supervisor
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History

MAX_STOP = 3.0
"""Seconds for which a process is stopped at most."""


@dataclass
class Chaos:
    """Called at every tick of a run: at random iterations it kills or stops a random process."""

    rng: random.Random
    due: list[int]
    done: Counter[str] = field(default_factory=Counter)
    stopped: list[tuple[float, NodeProcess]] = field(default_factory=list)
    """When which may go on."""

    def __call__(self, monitor: MonitorNode, supervisor: Supervisor, news: Sequence[str]) -> None:
        self._let_go_on()
        reached = min((len(known) for known in monitor.parameters.values()), default=0)
        running = [(name, child.process) for name, child in supervisor.children.items() if is_running(child.process)]
        if self.due and reached >= self.due[0] and running:
            self.due.pop(0)
            self._harm(*self.rng.choice(running))

    def _let_go_on(self) -> None:
        over = [process for until, process in self.stopped if time.monotonic() >= until and is_running(process)]
        self.stopped = [(until, process) for until, process in self.stopped if time.monotonic() < until]
        for process in over:
            os.kill(process.popen.pid, signal.SIGCONT)

    def _harm(self, name: str, process: NodeProcess) -> None:
        what = self.rng.choice(["kill", "kill", "end", "stop"])
        if what == "stop":
            self.stopped.append((time.monotonic() + self.rng.uniform(0.1, MAX_STOP), process))
        self.done[f"{what} {'player' if name == PLAYER else 'learner'}"] += 1
        os.kill(process.popen.pid, {"kill": signal.SIGKILL, "end": signal.SIGTERM, "stop": signal.SIGSTOP}[what])


def is_running(process: NodeProcess | None) -> TypeGuard[NodeProcess]:
    return process is not None and process.exit_code is None


def survive(file: Path, directory: Path, seed: int, events: int) -> Counter[str]:
    """Disturb runs until there were so many events, and compare each; returns what was done how often.

    A run gets more than it needs, but one whose monitor hears of many iterations at once ends before they have come.
    """
    experiment, rng, done = load_experiment(file), random.Random(seed), Counter[str]()
    reference = simulate_from_bag(experiment)
    while done.total() < events:
        done += _disturb(experiment, file, directory / str(done.total()), rng, events + 4 - done.total(), reference)
    return done


def _disturb(
    experiment: Experiment, file: Path, directory: Path, rng: random.Random, events: int, reference: History
) -> Counter[str]:
    """One run with so many events at most; every bit and edge of it must be that of the undisturbed reference."""
    chaos = Chaos(rng, sorted(rng.randint(1, experiment.iterations - 20) for _ in range(events)))
    (directory / "logs").mkdir(parents=True)
    result = Network(experiment, file, directory, {"hz": 50.0}, restarts=events).run(chaos)
    assert_same_histories(result.history, reference)
    assert audit(experiment.edge_schedule, result.delivered, experiment.iterations)["edge_mismatches"] == []
    return chaos.done


@pytest.fixture
def file(make_experiment: Callable[..., Path]) -> Path:
    return make_experiment(learners=4, iterations=100, schedule={"kind": "alternating"})


@pytest.mark.parametrize("seed", range(3))
def test_the_result_survives_chaos(file: Path, tmp_path: Path, seed: int) -> None:
    done = survive(file, tmp_path / "run", seed, events=20)
    print(dict(done))  # noqa: T201 - for those who wonder what happened


@pytest.mark.slow
@pytest.mark.timeout(1200)
def test_the_result_survives_ten_minutes_of_chaos(file: Path, tmp_path: Path) -> None:
    end, seed = time.monotonic() + 600, 1000
    while time.monotonic() < end:
        survive(file, tmp_path / f"run-{seed}", seed, events=25)
        seed += 1
