"""Exponents of power laws, and whether they are as small as they should be."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import numpy as np

from mabirds_bringup.bench.scale.cases import Sweep
from mabirds_bringup.bench.theory.slopes import interval, slope

SEEN = 2.0
"""Megabytes from which on growth can be told from what a process takes anyway."""

Typical = Callable[[Iterable[float]], float]

Repetition = Mapping[int, Mapping[str, float]]
"""Figures by size."""


def exponent(
    repetitions: Sequence[Repetition], measure: str, least: float = 0.0, typical: Typical = min
) -> dict[str, float | None] | None:
    """Slope in log-log axes.

    Parameters
    ----------
    repetitions : Sequence[Repetition]
        Of the same sizes.
    measure : str
        Name of a figure.
    least : float, optional
        Only sizes of which all repetitions have as much count.
    typical : Callable, optional
        Which value of a size is told. The least of times, to which other work on a machine adds; not of differences of
        times, which it makes too small as well.

    Returns
    -------
    dict or None
        ``of_sizes``: of what is told of each size; ``mean`` over repetitions, and ``half_width`` of Student's interval,
        None of one repetition. None where less than two sizes count.
    """
    sizes = [size for size in repetitions[0] if all(of[size][measure] > least for of in repetitions)]
    if len(sizes) < 2:
        return None
    at, values = np.array(sizes, dtype=np.float64), np.array([[of[n][measure] for n in sizes] for of in repetitions])
    mean, half_width = interval([slope(at, of) for of in values])
    return {
        "of_sizes": slope(at, np.array([typical(of) for of in values.T.tolist()])),
        "mean": mean,
        "half_width": half_width if np.isfinite(half_width) else None,
    }


def told(repetitions: Sequence[Repetition], typical: Typical = min) -> dict[str, Any]:
    """What is told of a sweep.

    Parameters
    ----------
    repetitions : Sequence[Repetition]
        Of the same sizes.
    typical : Callable, optional
        As of ``exponent``.

    Returns
    -------
    dict[str, Any]
        ``sizes``: what is typical of each figure, of a rate the most; ``exponents``: of time and memory.
    """
    sizes = {
        str(size): {key: (max if key == "rate" else typical)(of[size][key] for of in repetitions) for key in figures}
        for size, figures in repetitions[0].items()
    }
    exponents = {
        "milliseconds": exponent(repetitions, "milliseconds", 0.0, typical),
        "megabytes": exponent(repetitions, "megabytes", SEEN, typical),
    }
    return {"sizes": sizes, "exponents": exponents}


def targets(results: Mapping[str, Any], sweeps: Sequence[Sweep], learners: float) -> list[dict[str, Any]]:
    """Compare exponents of time with their limits.

    Parameters
    ----------
    results : Mapping[str, Any]
        Of ``told``, by the name of what grew.
    sweeps : Sequence[Sweep]
        That were solved.
    learners : float
        Limit for networks.

    Returns
    -------
    list[dict[str, Any]]
        name, value, target, at_most, met.
    """
    limits = {sweep.name: sweep.at_most for sweep in sweeps} | {"learners": learners}
    found = {name: results[name]["exponents"]["milliseconds"]["of_sizes"] for name in results}
    return [
        {
            "name": f"{name}: exponent of time",
            "value": value,
            "target": limits[name],
            "at_most": True,
            "met": value <= limits[name],
        }
        for name, value in found.items()
    ]
