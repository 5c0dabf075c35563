"""Times and memory of one size."""

import os
import tempfile
from functools import partial
from pathlib import Path

import yaml

from mabirds_bringup.bench.exchange.cases import ExchangeCase
from mabirds_bringup.bench.exchange.measure import measure, peak_megabytes, prepared
from mabirds_bringup.bench.solve.cases import SolveCase, weights
from mabirds_bringup.bench.solve.solving import fastest, solve
from mabirds_bringup.run.processes import learner_command

Figures = dict[str, float]

FEW = 4
"""By so many times the short run is shorter."""

LEAST = 1e-3
"""Milliseconds that an iteration takes at least, where starts on a busy machine were further apart than runs."""


def solved(case: SolveCase) -> Figures:
    """Solve a game, in a process that has solved none before.

    Parameters
    ----------
    case : SolveCase
        Which.

    Returns
    -------
    dict[str, float]
        milliseconds: of processor time; megabytes: by which the process grew with the game and its first solve.
    """
    before, game = peak_megabytes(os.getpid()), case.game
    asked = (game, *weights(game))
    solve(*asked)
    return {"megabytes": peak_megabytes(os.getpid()) - before, "milliseconds": fastest(lambda: solve(*asked))}


def network(learners: int, iterations: int) -> Figures:
    """Run a ring of learners on a game that costs next to nothing, a short run and a long one.

    What the long one takes more is of its iterations, whatever it takes to start, and whenever the watch hears of them.

    Parameters
    ----------
    learners : int
        How many processes.
    iterations : int
        Of the run.

    Returns
    -------
    dict[str, float]
        milliseconds: of a learner's processor time for an iteration; megabytes: the most that one ever had; rate:
        iterations a second.
    """
    few = iterations // FEW
    short, long = _run(learners, few), _run(learners, iterations)
    seconds = long["processor_seconds"] - short["processor_seconds"]
    return {
        "milliseconds": max(1e3 * seconds / (learners * (iterations - few)), LEAST),
        "megabytes": long["peak_megabytes"],
        "rate": long["rate"],
    }


def _run(learners: int, iterations: int) -> Figures:
    with tempfile.TemporaryDirectory(prefix="mabirds-scale-") as temporary:
        file, settings = Path(temporary) / "experiment.yaml", ExchangeCase(learners).settings(iterations)
        file.write_text(yaml.safe_dump({**settings, "schedule": {"kind": "directed_ring"}}), encoding="utf-8")
        return measure(prepared(file), partial(_command, file), Path(temporary) / "logs")


def _command(file: Path, name: str) -> list[str]:
    return learner_command(name, file)
