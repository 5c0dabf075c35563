"""Tables of a report: a line per row of a frame, its cells declared by column."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from mabirds_bringup.bench.frame import is_learner
from mabirds_bringup.bench.summary import SUCCESS_LEVELS, mean_range


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
    """The table of ``rows``; columns of measures that they have not are left out."""
    there = (column for column in columns if set(column.value.meta.root_names()) <= set(rows.columns))
    values = [(column, rows.select(column.value).to_series()) for column in there]
    shown = [(column, cells) for column, cells in values if not column.optional or cells.count()]
    cells = [[column.text(cell) for cell in cells] for column, cells in shown]
    return Section(title, [column.title for column, _ in shown], [list(line) for line in zip(*cells, strict=True)])


def number(form: str) -> Callable[[Any], str]:
    """Text of a number in the format ``form``; "never" for a time that there is not."""
    return lambda value: "never" if value is None else format(value, form)


def mean_range_text(cell: dict[str, float] | None) -> str:
    """Mean ± half-width; empty where there is none."""
    return f"{cell['mean']:.3f} ± {cell['half_width']:.3f}" if cell else ""


def scaled(time: pl.Expr) -> pl.Expr:
    """Times as multiples of the fastest."""
    return time / time.filter(time > 0).min().fill_null(1.0)


def rate(title: str, measure: str) -> Column:
    """A rate's mean and range."""
    return Column(title, pl.col(measure), mean_range_text, optional=True)


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
    *(
        Column(f"stays {level:.0%} [s]", pl.col("seconds_to_stay").list.get(index), number(".1f"))
        for index, level in enumerate(SUCCESS_LEVELS)
    ),
)
"""Time of an online iteration, and until SR is so high, scaled; until SR stays so high, in seconds."""

WORK = (
    per_iteration("gradient steps", "gradient_steps"),
    per_iteration("policy solves", "policy_solves"),
    Column("seconds", pl.col("iteration_seconds"), number(".3f")),
    Column("memory [MB]", pl.col("peak_memory"), number(".0f")),
)

AGREEMENT = (
    Column("", pl.format("{} ({})", "name", "group")),
    rate("CVR, last update", "updated_violation_rate"),
    rate("SR, last update", "updated_success_rate"),
    rate("CVR, end", "violation_rate"),
    rate("SR, end", "success_rate"),
    Column("distance of theta", pl.col("consensus_theta").struct.field("mean"), number(".1e")),
    Column("of omega", pl.col("consensus_omega").struct.field("mean"), number(".1e")),
    rate("of policies", "policy_distance"),
    rate("one constraint set", "same_constraints"),
)


def agreement_section(rows: pl.DataFrame) -> Section:
    """What the closing rounds change, a line per learner of a network."""
    return section("The closing rounds, and how far the learners are apart", rows.filter(is_learner()), AGREEMENT)


def entries_section(title: str, results: pl.DataFrame, columns: Mapping[str, str]) -> Section:
    """A line for each thing that measures of a game are of, means and ranges over learners and seeds.

    Parameters
    ----------
    title : str
        Of the table.
    results : DataFrame
        Of the learners to take together.
    columns : Mapping
        The measure of each column, by its title.

    Returns
    -------
    Section
        The table.
    """
    parts = pl.col("metric").str.extract_groups(r"^(?<measure>\w+)\[(?<thing>.*)\]$")
    entries = (
        results.with_columns(parts.alias("parts")).unnest("parts").filter(pl.col("measure").is_in(columns.values()))
    )
    values = {measure: mean_range(pl.col("value").filter(measure=measure)) for measure in columns.values()}
    lines = entries.group_by("thing", maintain_order=True).agg(**values)
    return section(title, lines, [Column("", pl.col("thing")), *(rate(head, of) for head, of in columns.items())])
