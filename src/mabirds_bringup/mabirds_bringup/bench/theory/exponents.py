"""One row per case: exponents in n with intervals over seeds, and values at the end."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import polars as pl

from mabirds_bringup.bench.theory.cases import TheoryCase
from mabirds_bringup.bench.theory.slopes import interval, slope
from mabirds_core.arrays import Array

CONSENSUS = ("theta", "omega", "policy")
CUMULATED = ("violation", "reward_gap", "regret", "population")

SHORTEST_FIT = {**dict.fromkeys(CONSENSUS, 50.0), **dict.fromkeys(CUMULATED, 10.0)}
"""Fits begin at the last iteration over this, and not before a window has been filled twice."""


def exponents(results: pl.DataFrame, cases: Mapping[str, TheoryCase]) -> pl.DataFrame:
    """A row per case.

    Parameters
    ----------
    results : DataFrame
        Of ``frame.SCHEMA``, from ``measure``.
    cases : Mapping
        By ``key``.

    Returns
    -------
    DataFrame
        ``group``, ``label``, ``name``, ``seeds``; for each quantity its exponent as ``mean`` and ``half_width``, null
        where it is not positive throughout; ``QUANTITY_tenth`` and ``QUANTITY_end``, means over seeds near N/10 and N.
    """
    rows = [
        _row(group, label, of_case, cases[key(group, label)].window)
        for (group, label), of_case in results.group_by("group", "label", maintain_order=True)
    ]
    return pl.DataFrame(rows, infer_schema_length=None)


def key(group: Any, label: Any) -> str:
    """Group and label as one name."""
    return f"{group}: {label}"


def _row(group: Any, label: Any, results: pl.DataFrame, window: int) -> dict[str, Any]:
    row: dict[str, Any] = {"group": group, "label": label, "name": label, "seeds": results["seed"].n_unique()}
    for (metric,), of_metric in results.group_by("metric", maintain_order=True):
        curves = [_curve(of_seed) for _, of_seed in of_metric.group_by("seed", maintain_order=True)]
        row[f"{metric}_end"] = float(np.mean([curve[-1, 1] for curve in curves]))
        row[f"{metric}_tenth"] = float(np.mean([_at_tenth(curve) for curve in curves]))
        if shortest := SHORTEST_FIT.get(str(metric)):
            row[str(metric)] = _exponent(curves, shortest, window)
    return row


def _curve(results: pl.DataFrame) -> Array:
    """Iterations and values, shape (bins, 2)."""
    return np.asarray(results.select("iteration", "value").to_numpy(), dtype=np.float64)


def _at_tenth(curve: Array) -> float:
    reached = curve[:, 0] <= curve[-1, 0] / 10
    return float(curve[reached][-1, 1] if reached.any() else curve[0, 1])


def _exponent(curves: list[Array], shortest: float, window: int) -> dict[str, float] | None:
    fitted = [curve[curve[:, 0] >= max(curve[-1, 0] / shortest, 2 * window)] for curve in curves]
    if any(len(curve) < 2 or (curve[:, 1] <= 0).any() for curve in fitted):
        return None
    return interval([slope(*curve.T) for curve in fitted])._asdict()
