"""Processor time of a solve of two drones on a lattice, as a learner of the shipped experiment makes one an iteration.

Example: OMP_NUM_THREADS=1 .venv/bin/python benches/lattice_solve.py (MABIRDS_KERNELS=off: by numpy and scipy alone)
"""

from pathlib import Path
from time import process_time
from typing import Annotated

import numpy as np
import typer

from mabirds_bringup.console import console
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import load_experiment
from mabirds_core.kernels.loading import library

DRONES = Path(__file__).resolve().parents[1] / "ros_ws" / "config" / "drones.yaml"


def main(solves: Annotated[int, typer.Option(min=3, help="How many.")] = 20) -> None:
    """Solve for random rewards and costs, each time on the lattice that is drawn."""
    experiment, rng = load_experiment(DRONES), np.random.default_rng(0)
    estimator = build_learner(experiment, experiment.learners[0]).estimator
    start = estimator.initial_parameters(experiment.seed)
    theta, omega = 0.3 * rng.normal(size=start.theta.shape), -np.abs(rng.normal(size=start.omega.shape))
    policy, seconds = None, list[float]()
    for _ in range(solves):
        before = process_time()
        policy = estimator.planner.plan(theta, omega, policy, rng)
        seconds.append(process_time() - before)
    with_what = "numpy and scipy" if library() is None else "compiled kernels"
    console.print(f"{with_what}: median {np.median(seconds):.2f} s, at most {max(seconds):.2f} s")


if __name__ == "__main__":
    typer.run(main)
