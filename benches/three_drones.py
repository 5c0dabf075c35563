"""How well three drones are learned by pairs: rates of the actor that flies, its gap, and what an iteration takes.

Example: .venv/bin/python benches/three_drones.py --first-seed 701 --seeds 2 --json
"""

import json
import os
import platform
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from mabirds_bringup.bench.outcome import drawn_streams, peak_memory
from mabirds_bringup.console import console, guarded_output
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import Progress, simulate_central

THREE = Path(__file__).resolve().parents[1] / "ros_ws" / "config" / "drones_three.yaml"
FLIGHTS = 2000
"""Of the last policy, by which it is judged."""
EVERY, SOME = 5, 200
"""Every how many iterations policies are judged on the way, and by how many flights."""
LATE = 20
"""Iterations after which the least success rate is looked for."""


@dataclass
class Record:
    """What is measured while one method learns.

    Attributes
    ----------
    game : Any
        Of three drones.
    experiment : Experiment
        What is learned.
    seconds, success, violation, gaps
        By iteration; seconds of the clock, of this process's processors the other one.
    """

    game: Any
    experiment: Experiment
    seconds: list[float] = field(default_factory=list)
    success: dict[int, float] = field(default_factory=dict)
    violation: dict[int, float] = field(default_factory=dict)
    gaps: dict[int, float] = field(default_factory=dict)
    judging: float = 0.0
    """Processor seconds of judging."""

    def keep(self, update: Progress) -> None:
        """One more iteration."""
        self.seconds.append(update.seconds)
        n = len(self.seconds)
        if n % EVERY and n < self.experiment.iterations:
            return
        before = time.process_time()
        rates = self.game.judge.imitation(update.policy, 1000 + n, SOME if n < self.experiment.iterations else FLIGHTS)
        self.success[n], self.violation[n] = rates.success_rate, rates.violation_rate
        self.gaps[n] = update.policy.gap(1000 + n)
        self.judging += time.process_time() - before
        console.print(f"iteration {n}: SR {self.success[n]:.3f}, CVR {self.violation[n]:.3f}, gap {self.gaps[n]:.2f}")


def measure(experiment: Experiment) -> dict[str, float]:
    """Learn with BICS from the demonstrations of all learners."""
    game = build_game(experiment)
    streams = drawn_streams(experiment, game)
    record, before = Record(game, experiment), time.process_time()
    simulate_central(experiment, "bics", streams, record.keep)
    spent = time.process_time() - before - record.judging
    last = experiment.iterations
    late = [n for n in record.gaps if n > LATE]
    return {
        "success rate": record.success[last],
        "violation rate": record.violation[last],
        f"least success rate after iteration {LATE}": min(record.success[n] for n in late),
        "gap of the last policy [nats]": record.gaps[last],
        f"largest gap after iteration {LATE} [nats]": max(record.gaps[n] for n in late),
        "median seconds an iteration": float(np.median(record.seconds)),
        "processor seconds an iteration": spent / last,
        "most memory [MB]": peak_memory(),
    }


def seeded(experiment: Experiment, seed: int) -> Experiment:
    """With demonstrations and rollouts of a seed."""
    demonstrations = experiment.demonstrations.model_copy(update={"seed": seed})
    return experiment.model_copy(update={"seed": seed, "demonstrations": demonstrations})


def main(
    first_seed: Annotated[int, typer.Option(help="Of demonstrations and rollouts.")] = 701,
    seeds: Annotated[int, typer.Option(help="How many.")] = 2,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,  # noqa: FBT002
) -> None:
    """Learn the shipped game of three drones with BICS, once a seed."""
    with guarded_output() as stdout:
        machine = {
            "system": platform.platform(),
            "cores": os.cpu_count(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "threads": os.environ.get("OMP_NUM_THREADS", "not set"),
        }
        results = dict[str, dict[str, float]]()
        console.print(machine)
        for seed in range(first_seed, first_seed + seeds):
            results[f"seed {seed}"] = measure(seeded(load_experiment(THREE), seed))
            console.print(results[f"seed {seed}"])
        if as_json:
            print(json.dumps({"machine": machine, "results": results}), file=stdout)


if __name__ == "__main__":
    typer.run(main)
