"""Tables of a report: a line per row of a frame, its cells declared by column."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from mabirds_bringup.bench.summary import SUCCESS_LEVELS, MeanRange


@dataclass(frozen=True)
class Section:
    """One table of a report, ready to be shown."""

    title: str
    columns: Sequence[str]
    lines: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Column:
    """A column: what it shows of every row, and how. ``optional``: left out where no row has it."""

    title: str
    value: pl.Expr
    text: Callable[[Any], str] = str
    optional: bool = False


def section(title: str, rows: pl.DataFrame, columns: Sequence[Column]) -> Section:
    """The table of ``rows``."""
    found = [(column, rows.select(column.value).to_series()) for column in columns]
    shown = [(column, values) for column, values in found if not column.optional or values.count()]
    cells = [[column.text(value) for value in values] for column, values in shown]
    return Section(title, [column.title for column, _ in shown], [list(line) for line in zip(*cells, strict=True)])


def number(form: str) -> Callable[[Any], str]:
    """Text of a number in the format ``form``; "never" for a time that there is not."""
    return lambda value: "never" if value is None else format(value, form)


def mean_range_text(cell: dict[str, float] | None) -> str:
    """Mean ± half-width; empty where there is none."""
    return str(MeanRange(**cell)) if cell else ""


def scaled(time: pl.Expr) -> pl.Expr:
    """Times as multiples of the fastest."""
    return time / time.filter(time > 0).min().fill_null(1.0)


def rate(title: str, summary: str, *, optional: bool = False) -> Column:
    """A rate's mean and range."""
    return Column(title, pl.col(summary), mean_range_text, optional)


def per_iteration(title: str, total: str) -> Column:
    """Cost per online iteration."""
    return Column(title, pl.col(total) / pl.col("iterations"), number(".1f"))


NAME = Column("", pl.col("name"))

TIMES = (
    Column("STPOI", scaled(pl.col("iteration_seconds")), number(".3f")),
    *(
        Column(f"{level:.0%} ST", scaled(pl.col("seconds_to_level").list.get(index)), number(".3f"))
        for index, level in enumerate(SUCCESS_LEVELS)
    ),
)
"""Time of an online iteration, and until SR is so high, scaled."""

WORK = (
    per_iteration("gradient steps", "gradient_steps"),
    per_iteration("policy solves", "policy_solves"),
    Column("seconds", pl.col("iteration_seconds"), number(".3f")),
)
