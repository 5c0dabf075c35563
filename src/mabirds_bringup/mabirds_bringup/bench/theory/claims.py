"""What the paper prints of each rate, what its update implies (docs/theory.md derives it), and what was measured."""

from collections.abc import Sequence
from typing import Any

import polars as pl

from mabirds_bringup.bench.tables import Section, mean_range_text
from mabirds_bringup.bench.targets import judged
from mabirds_bringup.bench.theory.cases import LARGE, LONGER, RATES, SETTINGS, Etas, etas_text
from mabirds_bringup.bench.theory.slopes import Interval
from mabirds_core.errors import ExperimentError

TOLERANCE = 0.05
"""Of exponents of consensus, and of half their intervals."""

SUM_TOLERANCE = 0.1
"""Of exponents of sums, which carry their beginning with them."""

FLOOR_TOLERANCE = 0.1
"""Relative, of the window's regret above its floor."""

HARD = [f"free, {etas_text(etas)}" for etas in SETTINGS]
LARGE_STEPS = [f"{etas_text(etas)}, steps {LARGE:g}" for etas in SETTINGS]
FREE = [case.label for case in RATES]

CLAIMS: Sequence[tuple[str, str, str, str, Sequence[str], str]] = (
    ("disagreement of theta", "n^-eta1", "n^-eta2, theta's own step", "rates", FREE, "theta"),
    ("disagreement of omega", "n^-eta2", "n^-eta1, omega's own step", "rates", FREE, "omega"),
    ("disagreement of policies", "consensus", "n^-min(eta1, eta2)", "rates", FREE, "policy"),
    ("cumulated violations, b > 0", "N^eta2 + 1", "at most max omega N^eta1 + N^1/2", "rates", FREE, "violation"),
    (f"cumulated violations, b = 0, steps {LARGE:g}, {LONGER} N", "N^eta2 + 1", "N^eta1", "hard", HARD, "violation"),
    (
        "mean regret, window of 1",
        "N^(eta1-1) + N^(eta2-1) + 1/N",
        "0: the variance of demonstrations / (N_L l) stays",
        "rates",
        FREE,
        "regret",
    ),
    (
        "mean squared population gradient",
        "N^(eta1-1) + N^(eta2-1) + 1/N",
        "at most N^(max(eta1, eta2)-1)",
        "rates",
        FREE,
        "population",
    ),
    (f"the same, steps {LARGE:g}", "outside the bound", "the same", "large", LARGE_STEPS, "population"),
    ("mean reward gap", "not printed", "at most the root of the population gradient's", "rates", FREE, "reward_gap"),
)
"""Quantity, in print, implied, and where it is measured: group, labels, column."""


def claims_section(rows: pl.DataFrame) -> Section:
    """A line per quantity, a column per setting."""
    lines = [
        [quantity, printed, implied, *(mean_range_text(_cell(rows, group, label, column)) for label in labels)]
        for quantity, printed, implied, group, labels, column in CLAIMS
    ]
    head = ("exponent of", "the paper prints", "its update implies", *(f"measured at {etas_text(e)}" for e in SETTINGS))
    return Section("What the paper prints, what its update implies, what was measured", head, lines)


def targets(rows: pl.DataFrame) -> pl.DataFrame:
    """Exponents of consensus with their intervals; what is implied of the others."""
    consensus = [
        target
        for etas in SETTINGS
        for name, exponent in (("theta", -etas.eta2), ("omega", -etas.eta1))
        for target in _consensus_targets(rows, etas, name, exponent)
    ]
    others = [
        *(_violations_target(rows, etas, label) for etas, label in zip(SETTINGS, HARD, strict=True)),
        _printed_target(rows),
        *(_population_target(rows, etas) for etas in SETTINGS),
        _floor_target(rows),
    ]
    return judged(pl.DataFrame([*consensus, *others], schema=["name", "value", "target", "at_most"], orient="row"))


Target = tuple[str, float, float, bool]


def _consensus_targets(rows: pl.DataFrame, etas: Etas, name: str, implied: float) -> list[Target]:
    mean, half_width = _interval(rows, "rates", etas_text(etas), name)
    what = f"{name} at {etas_text(etas)}"
    return [
        (f"{what}: distance of the exponent from {implied:g}", abs(mean - implied), TOLERANCE, True),
        (f"{what}: half width of its interval", half_width, TOLERANCE, True),
    ]


def _violations_target(rows: pl.DataFrame, etas: Etas, label: str) -> Target:
    distance = abs(_interval(rows, "hard", label, "violation").mean - etas.eta1)
    return f"violations, b = 0, {label}: distance of the exponent from eta1", distance, SUM_TOLERANCE, True


def _printed_target(rows: pl.DataFrame) -> Target:
    """Where eta1 is the larger, the exponent is above what is printed."""
    mean, half_width = _interval(rows, "hard", HARD[-1], "violation")
    above = mean - half_width - SETTINGS[-1].eta2
    return f"violations, b = 0, {HARD[-1]}: exponent above the printed eta2, at least", above, 0.0, False


def _population_target(rows: pl.DataFrame, etas: Etas) -> Target:
    mean, half_width = _interval(rows, "rates", etas_text(etas), "population")
    return f"population gradient at {etas_text(etas)}: exponent, at most", mean + half_width, max(etas) - 1, True


def _floor_target(rows: pl.DataFrame) -> Target:
    row = _row(rows, "rates", RATES[0].label)
    excess = abs(row["regret_end"] / row["floor_end"] - 1)
    return "window regret, l = 1: relative distance from its floor", excess, FLOOR_TOLERANCE, True


def _row(rows: pl.DataFrame, group: str, label: str) -> dict[str, Any]:
    return rows.filter(group=group, label=label).to_dicts()[0]


def _cell(rows: pl.DataFrame, group: str, label: str, column: str) -> dict[str, float] | None:
    cell: dict[str, float] | None = _row(rows, group, label)[column]
    return cell


def _interval(rows: pl.DataFrame, group: str, label: str, column: str) -> Interval:
    cell = _cell(rows, group, label, column)
    if cell is None:
        raise ExperimentError(f"{group}, {label}: {column} has no exponent; take more iterations")
    return Interval(**cell)
