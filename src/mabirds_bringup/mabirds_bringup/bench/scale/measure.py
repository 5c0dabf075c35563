"""Times and memory of one size."""

import tempfile
from functools import partial
from pathlib import Path

import yaml

from mabirds_bringup.bench.exchange.cases import ExchangeCase
from mabirds_bringup.bench.exchange.measure import measure, prepared
from mabirds_bringup.bench.solve.cases import SolveCase, weights
from mabirds_bringup.bench.solve.measure import megabytes
from mabirds_bringup.bench.solve.solving import fastest, solve
from mabirds_bringup.run.processes import learner_command

Figures = dict[str, float]


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
    before, game = megabytes(), case.game
    asked = (game, *weights(game))
    solve(*asked)
    return {"megabytes": megabytes() - before, "milliseconds": fastest(lambda: solve(*asked))}


def network(learners: int, iterations: int) -> Figures:
    """Run a ring of learners on a game that costs next to nothing.

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
    with tempfile.TemporaryDirectory(prefix="mabirds-scale-") as temporary:
        file, settings = Path(temporary) / "experiment.yaml", ExchangeCase(learners).settings(iterations)
        file.write_text(yaml.safe_dump({**settings, "schedule": {"kind": "directed_ring"}}), encoding="utf-8")
        found = measure(prepared(file), partial(_command, file), Path(temporary) / "logs")
    return {
        "milliseconds": found["processor_milliseconds"],
        "megabytes": found["peak_megabytes"],
        "rate": found["rate"],
    }


def _command(file: Path, name: str) -> list[str]:
    return learner_command(name, file)
