"""How well three drones are learned by pairs: rates of the actors that fly, their gaps, and what an iteration takes.

Example: .venv/bin/python benches/three_drones.py --method mabirds --first-seed 702 --seeds 1 --json
"""

import json
import os
import platform
import time
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from mabirds_bringup.bench.outcome import drawn_streams, peak_memory
from mabirds_bringup.console import console, guarded_output
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import Progress, simulate, simulate_central
from mabirds_core.metrics.metrics import consensus_distance

THREE = Path(__file__).resolve().parents[1] / "ros_ws" / "config" / "drones_three.yaml"
FLIGHTS = 2000
"""Of the last policy, by which it is judged."""
EVERY, SOME = 5, 200
"""Every how many iterations policies are judged on the way, and by how many flights."""
LATE = 20
"""Iterations after which the least success rate is looked for."""


class Method(Enum):
    """Who learns."""

    BICS = "bics"
    MABIRDS = "mabirds"


@dataclass
class Record:
    """What is measured while a method, or one of its learners, learns.

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
        so_far = f"SR {rates.success_rate:.3f}, CVR {rates.violation_rate:.3f}, gap {self.gaps[n]:.2f}"
        console.print(f"{update.name}, iteration {n}: {so_far}")


def measure(experiment: Experiment, method: Method) -> dict[str, float]:
    """Learn, with BICS from the demonstrations of all learners, or with MA-BIRDS in each of them.

    Rates and gaps are those of the worst learner, seconds of the clock a median, of processors a mean.
    """
    game = build_game(experiment)
    streams = drawn_streams(experiment, game)
    before = time.process_time()
    if method is Method.BICS:
        records = {method.value: Record(game, experiment)}
        history = simulate_central(experiment, method.value, streams, records[method.value].keep)
    else:
        records = {name: Record(game, experiment) for name in experiment.learners}
        history = simulate(experiment, streams, lambda update: records[update.name].keep(update))
    spent = time.process_time() - before - sum(record.judging for record in records.values())
    last, each = experiment.iterations, records.values()
    late = [n for n in next(iter(each)).gaps if n > LATE]
    return {
        "success rate": min(record.success[last] for record in each),
        "violation rate": max(record.violation[last] for record in each),
        f"least success rate after iteration {LATE}": min(record.success[n] for record in each for n in late),
        "gap of the last policy [nats]": max(record.gaps[last] for record in each),
        f"largest gap after iteration {LATE} [nats]": max(record.gaps[n] for record in each for n in late),
        "theta apart": consensus_distance([states[-1].theta for states in history.values()]),
        "norm of the first theta": float(np.linalg.norm(next(iter(history.values()))[-1].theta)),
        "median seconds an iteration": float(np.median([record.seconds for record in each])),
        "processor seconds an iteration": spent / last / len(each),
        "most memory [MB]": peak_memory(),
    }


def seeded(experiment: Experiment, seed: int) -> Experiment:
    """With demonstrations and rollouts of a seed."""
    demonstrations = experiment.demonstrations.model_copy(update={"seed": seed})
    return experiment.model_copy(update={"seed": seed, "demonstrations": demonstrations})


def main(
    method: Annotated[Method, typer.Option(help="Who learns: one who is given all, or four learners.")] = Method.BICS,
    first_seed: Annotated[int, typer.Option(help="Of demonstrations and rollouts.")] = 701,
    seeds: Annotated[int, typer.Option(help="How many.")] = 2,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object.")] = False,  # noqa: FBT002
) -> None:
    """Learn the shipped game of three drones, once a seed."""
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
            results[f"seed {seed}"] = measure(seeded(load_experiment(THREE), seed), method)
            console.print(results[f"seed {seed}"])
        if as_json:
            print(json.dumps({"machine": machine, "results": results}), file=stdout)


if __name__ == "__main__":
    typer.run(main)
