"""What is asked of the measured cases, and whether they do it."""

from collections.abc import Mapping
from typing import Any

from mabirds_bringup.bench.solve.cases import ITERATIONS, SolveCase

MOST_DIFFERENCE = 1e-10
"""Between totals of features, ours and others'."""


def targets(cases: tuple[SolveCase, ...], results: Mapping[str, Mapping[str, float]]) -> list[dict[str, Any]]:
    """Compare with the limits.

    Parameters
    ----------
    cases : tuple[SolveCase, ...]
        That were solved.
    results : Mapping[str, Mapping[str, float]]
        What was measured, by the name of the case or of the shipped experiment.

    Returns
    -------
    list[dict[str, Any]]
        name, value, target, at_most, met.
    """
    limits = {case.name: dict(case.at_most) for case in cases} | {
        f"iteration of {name}": dict(limit) for name, limit in ITERATIONS.items()
    }
    for name, measured in results.items():
        limits[name] |= {key: MOST_DIFFERENCE for key in measured if key.endswith("_difference")}
    return [
        _target(f"{name}: {measure.replace('_', ' ')}", results[name][measure], limit)
        for name in results
        for measure, limit in limits[name].items()
    ]


def _target(name: str, value: float, target: float) -> dict[str, Any]:
    return {"name": name, "value": value, "target": target, "at_most": True, "met": value <= target}
