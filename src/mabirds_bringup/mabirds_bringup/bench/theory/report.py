"""The report: the table of claims, tables by group, targets, pictures."""

from pathlib import Path
from typing import Any

import polars as pl

from mabirds_bringup.bench.report import Page, write_report
from mabirds_bringup.bench.tables import NAME, Column, Section, mean_range_text, number, section
from mabirds_bringup.bench.theory.cases import BASE, CASES, LARGE, LONGER, N_LEARNERS, STEP, TheoryCase
from mabirds_bringup.bench.theory.claims import claims_section, targets
from mabirds_bringup.bench.theory.exponents import CONSENSUS, CUMULATED, exponents, key
from mabirds_bringup.bench.theory.figures import save_figures
from mabirds_bringup.bench.theory.inner import inner_rows
from mabirds_bringup.bench.theory.network import OMEGA_BOUND, WEIGHT
from mabirds_bringup.bench.theory.problem import Problem
from mabirds_core.consensus.assumptions import validate

TITLE = "Theorem 1 as measured"
NOTE = (
    f"{N_LEARNERS} learners, two experts on a 3x3 map, exact expectations. Exponents are slopes in log-log axes,"
    " their 95 % intervals over seeds by Student; consensus from N/50 on, sums and means over iterations from N/10 on."
    f" Steps alpha = beta = {STEP:g}, within the theorem's bound 1/{N_LEARNERS}, where nothing else is said."
    " No exponent: the sum changes its sign. Derivations: docs/theory.md."
)

GROUPS = {
    "rates": f"Steps within the bound, {STEP:g} < 1/{N_LEARNERS}",
    "large": f"Steps beyond the bound: {LARGE:g} and {10 * LARGE:g}",
    "window": "Windows (first row: l = 1)",
    "schedule": "Schedules (first row: ring)",
    "hard": (
        f"Hard constraints, b = 0, steps {LARGE:g}, {LONGER} N iterations: omega free, within {OMEGA_BOUND:g}, with"
        f" weight {WEIGHT:g}"
    ),
    "default": "The default rule with the mean of all demonstrations, no step given",
}


def _exponent(title: str, column: str) -> Column:
    return Column(title, pl.col(column), lambda cell: mean_range_text(cell) or "-")


def _value(title: str, column: str) -> Column:
    return Column(title, pl.col(column), number(".3g"))


EXPONENTS = (
    NAME,
    *(_exponent(f"{name} ~ n^", name) for name in CONSENSUS),
    *(_exponent(f"{name.replace('_', ' ')} ~ N^", name) for name in CUMULATED),
)

VALUES = (
    Column("", pl.concat_str("group", pl.lit(": "), "name")),
    *(_value(name.replace("_", " "), f"{name}_end") for name in (*CONSENSUS, *CUMULATED)),
    _value("floor of regret", "floor_end"),
    _value("largest cost at N/10", "largest_cost_tenth"),
    _value("at N", "largest_cost_end"),
)

INNER = (
    Column("", pl.col("inner problem")),
    Column("tolerance of the gradient", pl.col("tolerance"), number(".0e")),
    Column("largest cost", pl.col("largest_cost"), number(".2f")),
)


def by_key() -> dict[str, TheoryCase]:
    """All cases by group and label."""
    return {key(case.group, case.label): case for case in CASES}


def sections(rows: pl.DataFrame) -> list[Section]:
    """The claims, a table of each group, schedules, the inner problem."""
    base = rows.filter(group=BASE.group, label=BASE.label)
    tables = [claims_section(rows)]
    for group, title in GROUPS.items():
        first = base if group in {"window", "schedule"} else base.clear()
        tables.append(section(title, pl.concat([first, rows.filter(group=group)]), EXPONENTS))
    inner = section("The inner problem's optimum at the experts' reward, by L-BFGS", pl.DataFrame(inner_rows()), INNER)
    return [*tables, section("Values at N", rows, VALUES), schedules_section(), inner]


def schedules_section() -> Section:
    """B and the contraction of each schedule."""
    lines = []
    for case in (BASE, *(case for case in CASES if case.group == "schedule")):
        found = validate(Problem(case, 1, 0).experiment.edge_schedule)
        name = "ring" if case is BASE else case.label
        lines.append([name, str(found.connectivity_window), f"{found.contraction:.3f}"])
    return Section(
        "Schedules: Assumption 2's B, and by what B iterations shrink disagreement", ["", "B", "factor"], lines
    )


def write_theory(results: pl.DataFrame, directory: Path, command: str) -> dict[str, Any]:
    """Fill ``directory``; returns what --json prints."""
    rows = exponents(results, by_key())
    pictures = save_figures(results, directory)
    page = Page(TITLE, NOTE, pictures, sections(rows), rows, targets(rows), {"inner": inner_rows()})
    return write_report(page, results, directory, command)
