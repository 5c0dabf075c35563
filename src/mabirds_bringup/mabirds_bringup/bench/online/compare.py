"""The highest rate of demonstrations at which no backlog grows, of each method on the shipped experiments.

The player sends as fast as it is let: it holds back for whoever has ``max_in_flight`` demonstrations before them, so
that the rate at which iterations follow each other is the highest that lasts.
"""

import tempfile
from collections import defaultdict
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

import yaml

from mabirds_bringup.bench.exchange.measure import measure, prepared
from mabirds_bringup.bench.online.shares import shared_out
from mabirds_bringup.evaluate.parallel import processors
from mabirds_bringup.run.processes import baseline_command, learner_command
from mabirds_core.errors import MabirdsError
from mabirds_core.experiment.file import load_experiment

LEARNERS = "mabirds"
"""The method that is no central one."""

METHODS = (LEARNERS, "bics", "ftl", "dlm")

RIVAL = "bics"
"""One learner that gets everything: whom a network of learners must keep pace with."""

Figures = dict[str, float]


def lengthened(source: Path, directory: Path, iterations: int) -> Path:
    """A shipped experiment with more demonstrations, which are recorded.

    Parameters
    ----------
    source : Path
        Its file.
    directory : Path
        Where the new file and the bag go.
    iterations : int
        How many.

    Returns
    -------
    Path
        The new file.
    """
    content = yaml.safe_load(source.read_text(encoding="utf-8"))
    content["iterations"] = content["demonstrations"]["per_learner"] = iterations
    content["demonstrations"]["bag"] = "bag"
    directory.mkdir()
    file = directory / source.name
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return prepared(file)


def compare(source: Path, iterations: int, repetitions: int, share: float = 1.0) -> Figures:
    """Time all methods in turns.

    Parameters
    ----------
    source : Path
        Of a shipped experiment.
    iterations : int
        Of each run.
    repetitions : int
        Of each method; the fastest is told, the ratio is a median.
    share : float, optional
        Of a processor that each process gets, in (0, 1]; 1: what is there.

    Returns
    -------
    dict[str, float]
        Iterations a second, the most that processors allow, and processor milliseconds of each learning process and of
        the player, by method; how many times the rival's rate learners have.
    """
    runs: defaultdict[str, list[Figures]] = defaultdict(list)
    require_room(share, len(load_experiment(source).learners) + 1)
    with tempfile.TemporaryDirectory(prefix="mabirds-online-") as temporary:
        file = lengthened(source, Path(temporary) / "experiment", iterations)
        for number in range(repetitions):
            for method in METHODS:
                logs = Path(temporary) / f"{method}_{number}"
                central = "" if method == LEARNERS else method
                runs[method].append(_measured(file, central, logs, share))
    fastest = {method: max(figures, key=lambda run: run["rate"]) for method, figures in runs.items()}
    keys = ("rate", "processor_milliseconds", "player_milliseconds")
    told = {f"{method}_{key}": run[key] for method, run in fastest.items() for key in keys}
    learners = len(load_experiment(source).learners)
    told |= {
        f"{method}_processor_bound": bound(run, learners if method == LEARNERS else 1)
        for method, run in fastest.items()
    }
    pairs = zip(runs[LEARNERS], runs[RIVAL], strict=True)
    return {**told, "times_of_rival": median(ours["rate"] / theirs["rate"] for ours, theirs in pairs)}


def require_room(share: float, processes: int) -> None:
    """Check that shares do not exceed what is there.

    Parameters
    ----------
    share : float
        Of a processor; 1: nobody is limited.
    processes : int
        That each get it.

    Raises
    ------
    MabirdsError
        They would.
    """
    if share < 1 and share * processes > processors():
        raise MabirdsError(
            f"--share {share:g}: {processes} processes would need {share * processes:g} processors, and there are"
            f" {processors()}; at most {processors() / processes:.2f} is left for each"
        )


def _measured(file: Path, method: str, logs: Path, share: float) -> Figures:
    command = partial(_command, file, method)
    if share == 1:
        return measure(file, command, logs, method)
    with shared_out(share) as shares:
        return measure(file, command, logs, method, shares.limit)


def bound(run: Figures, processes: int) -> float:
    """The highest rate that the processors of this machine allow, were all of them busy with nothing else.

    Parameters
    ----------
    run : dict[str, float]
        What each process takes for an iteration.
    processes : int
        That learn, beside the player.

    Returns
    -------
    float
        Iterations a second.
    """
    return 1e3 * processors() / (processes * run["processor_milliseconds"] + run["player_milliseconds"])


def _command(file: Path, method: str, name: str) -> list[str]:
    return baseline_command(method, file) if method else learner_command(name, file)


def targets(results: dict[str, Figures]) -> list[dict[str, Any]]:
    """Compare with what is asked for.

    Parameters
    ----------
    results : dict[str, Figures]
        By experiment.

    Returns
    -------
    list[dict[str, Any]]
        name, value, target, at_most, met.
    """
    values = {f"{name}: rate of learners, of {RIVAL}'s": found["times_of_rival"] for name, found in results.items()}
    return [
        {"name": name, "value": value, "target": 1.0, "at_most": False, "met": value >= 1.0}
        for name, value in values.items()
    ]
