"""One experiment in parts, each started by ``mabirds run --only`` on a host of its own in a virtual network."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from identity import assert_same_histories
from namespaces import VirtualLan, virtual_lan

from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.run.stored_run import load_run
from mabirds_core.experiment.simulate import History
from mabirds_learner.checkpoint import newest_of_anybody

MABIRDS = str(Path(sys.executable).with_name("mabirds"))

HALVES = {"left": ["learner_1", "learner_2"], "right": ["learner_3", "expert_player"]}


def settings(iterations: int = 10) -> dict[str, Any]:
    """Keywords of ``make_experiment`` for three learners in a ring."""
    return {"learners": 3, "iterations": iterations, "schedule": {"kind": "directed_ring"}}


@dataclass
class Halves:
    """Hosts with a part of the experiment each, below one directory."""

    lan: VirtualLan
    directory: Path
    hz: float = 20.0
    parts: Mapping[str, Sequence[str]] = field(default_factory=lambda: HALVES)
    running: dict[str, "subprocess.Popen[str]"] = field(default_factory=dict)
    environments: dict[str, dict[str, str]] = field(default_factory=dict)
    """By host, what its processes have besides this one's."""

    def start(self, host: str, *arguments: object) -> None:
        """``mabirds run`` on a host, its output after what it said before."""
        command = [MABIRDS, "run", *map(str, arguments), "--out", str(self.directory / host)]
        with self._output(host).open("a", encoding="utf-8") as output:
            self.running[host] = subprocess.Popen(
                self.lan.inside(host, command),
                stdout=output,
                stderr=output,
                text=True,
                env={**os.environ, **self.environments.get(host, {})},
            )

    def start_part(self, host: str, file: Path, *options: str) -> None:
        """The command of a host, the same each time."""
        only = [word for name in self.parts[host] for word in ("--only", name)]
        self.start(host, file, "--hz", self.hz, "--run", "monday", *only, *options)

    def _output(self, host: str) -> Path:
        return self.directory / f"{host}.txt"

    def said(self, host: str) -> str:
        """All output of a host so far."""
        return self._output(host).read_text(encoding="utf-8")

    def run_directory(self, host: str) -> Path:
        """Of the newest run of a host."""
        return (self.directory / host / "latest").resolve()

    def newest(self, host: str) -> int:
        """The newest iteration that a learner of a host has written down."""
        places = (self.directory / host / "latest").glob("checkpoints/*")
        return max((found[0] for found in map(newest_of_anybody, places) if found), default=0)

    def wait(self, condition: Callable[[], Any], timeout: float = 60.0) -> None:
        deadline = time.monotonic() + timeout
        while not condition():
            assert time.monotonic() < deadline, self.explained("not in time")
            time.sleep(0.05)

    def explained(self, words: str) -> str:
        """Words, and the last that every host said."""
        return "\n".join([words, *(f"{host}: {self.said(host)[-600:]}" for host in self.parts)])

    def end(self, host: str, timeout: float = 150.0) -> int:
        """Exit code; a part that misses the farewell of the others stays for a minute."""
        return self.running[host].wait(timeout)

    def stop(self) -> None:
        for process in self.running.values():
            process.kill()
            process.wait()

    def assert_whole(self, host: str, expected: History) -> None:
        """Exit code 0, certified, and to the bit what the algorithm in one loop gives."""
        assert self.running[host].returncode == 0, self.explained(f"{host} ended with another exit code")
        run = load_run(self.run_directory(host))
        summary = json.loads((run.directory / "summary.json").read_text(encoding="utf-8"))
        assert (summary["complete"], set(summary["last_iterations"].values())) == (True, {run.last})
        with run.open_history() as kept:
            assert_same_histories(kept.without_gap(), expected)

    def assert_all_whole(self, file: Path) -> None:
        """Wait for the end of all; every host has every bit."""
        from mabirds_core.experiment.file import load_experiment

        expected = simulate_from_bag(load_experiment(file))
        for host in self.parts:
            self.end(host)
            self.assert_whole(host, expected)


@contextmanager
def two_halves(directory: Path, hz: float = 20.0) -> Iterator[Halves]:
    """A network of two hosts; what still runs at the end is killed."""
    with virtual_lan(list(HALVES)) as lan:
        halves = Halves(lan, directory, hz)
        try:
            yield halves
        finally:
            halves.stop()
