"""Learners, learners with checkpoints and bare nodes in turns, so that all meet the same machine."""

import tempfile
from collections import defaultdict
from collections.abc import Mapping
from functools import partial
from pathlib import Path
from statistics import median
from typing import Any

from mabirds_bringup.bench.exchange.cases import ExchangeCase
from mabirds_bringup.bench.exchange.learning import learning_milliseconds
from mabirds_bringup.bench.exchange.measure import measure, prepared
from mabirds_bringup.run.processes import bare_command, learner_command

Figures = dict[str, float]


def compare(case: ExchangeCase, iterations: int, repetitions: int) -> Figures:
    """Time a case.

    Parameters
    ----------
    case : ExchangeCase
        Which network.
    iterations : int
        Of each run.
    repetitions : int
        Of each kind; the fastest counts, and ratios are medians over repetitions.

    Returns
    -------
    dict[str, float]
        Figures of each kind by their names, and ratios.
    """
    runs: defaultdict[str, list[Figures]] = defaultdict(list)
    with tempfile.TemporaryDirectory(prefix="mabirds-exchange-") as temporary:
        place = Path(temporary)
        file = prepared(case.write(place, iterations))
        for number in range(repetitions):
            for kind in ("bare", "learner", "durable"):
                directory = place / f"{kind}_{number}"
                runs[kind].append(measure(file, partial(_command, kind, file, directory), directory))
        learning = learning_milliseconds(file)
    return {**_fastest(runs), **ratios(runs), "learning_milliseconds": learning}


def _command(kind: str, file: Path, directory: Path, name: str) -> list[str]:
    if kind == "bare":
        return bare_command(name, file)
    parameters = {"checkpoints": str(directory / name)} if kind == "durable" else {}
    return learner_command(name, file, **parameters)


def _fastest(runs: Mapping[str, list[Figures]]) -> Figures:
    best = {kind: min(figures, key=lambda run: run["processor_milliseconds"]) for kind, figures in runs.items()}
    return {f"{kind}_{name}": value for kind, figures in best.items() for name, value in figures.items()}


def ratios(runs: Mapping[str, list[Figures]]) -> Figures:
    """Medians over runs that followed each other.

    Parameters
    ----------
    runs : Mapping[str, list[Figures]]
        Of ``bare``, ``learner`` and ``durable``.

    Returns
    -------
    dict[str, float]
        times_of_bare_processor_time, share_of_bare_rate, times_without_checkpoints.
    """
    bare, learner, durable = (runs[kind] for kind in ("bare", "learner", "durable"))
    pairs = {
        "times_of_bare_processor_time": ("processor_milliseconds", learner, bare),
        "share_of_bare_rate": ("rate", learner, bare),
        "times_without_checkpoints": ("rate", learner, durable),
    }
    return {
        name: median(above[key] / below[key] for above, below in zip(first, second, strict=True))
        for name, (key, first, second) in pairs.items()
    }


def targets(cases: tuple[ExchangeCase, ...], results: Mapping[str, Figures]) -> list[dict[str, Any]]:
    """Compare with what is asked for.

    Parameters
    ----------
    cases : tuple[ExchangeCase, ...]
        That were timed.
    results : Mapping[str, Figures]
        By their names.

    Returns
    -------
    list[dict[str, Any]]
        name, value, target, at_most, met.
    """
    return [
        _target(f"{case.name}: {measure.replace('_', ' ')}", results[case.name][measure], limit, at_most=at_most)
        for case in cases
        for limits, at_most in ((case.at_most, True), (case.at_least, False))
        for measure, limit in limits.items()
    ]


def _target(name: str, value: float, target: float, *, at_most: bool) -> dict[str, Any]:
    met = value <= target if at_most else value >= target
    return {"name": name, "value": value, "target": target, "at_most": at_most, "met": met}
