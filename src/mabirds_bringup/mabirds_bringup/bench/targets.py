"""What a benchmark is to show, and whether it does: limits on the measures of rows."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import polars as pl

from mabirds_bringup.bench.cases import MABIRDS
from mabirds_bringup.bench.tables import Column, number

NAME = pl.col("name")


@dataclass(frozen=True)
class Limit:
    """What a figure of a row may at most be, or is at least to be, by label; other labels have no limit."""

    words: str
    value: pl.Expr
    by_label: Mapping[str, float]
    at_most: bool = False

    def targets(self, rows: pl.DataFrame, name: pl.Expr) -> pl.DataFrame:
        """Targets of the rows that have a value and a limit, with ``row``."""
        return rows.select(
            "row",
            name=pl.concat_str(name, pl.lit(self.words), separator=" "),
            value=self.value.cast(pl.Float64),
            target=pl.col("label").replace_strict(self.by_label, default=None, return_dtype=pl.Float64),
            at_most=pl.lit(self.at_most),
        ).drop_nulls()


@dataclass(frozen=True)
class Limits:
    """Limits of the rows of a group, which targets call ``name``."""

    group: str
    limits: Sequence[Limit]
    name: pl.Expr = NAME

    def targets(self, rows: pl.DataFrame) -> pl.DataFrame:
        """MetricsRow by row: name, value, target, at_most, met."""
        own = rows.filter(group=self.group).with_row_index("row")
        found = pl.concat([limit.targets(own, self.name) for limit in self.limits])
        return judged(found.sort("row", maintain_order=True).drop("row"))


def judged(targets: pl.DataFrame) -> pl.DataFrame:
    """With ``met``: is the value on the right side of its limit?"""
    value, target = pl.col("value"), pl.col("target")
    return targets.with_columns(met=pl.when("at_most").then(value <= target).otherwise(value >= target))


def mean_of(measure: str) -> pl.Expr:
    """The mean of a mean and range."""
    return pl.col(measure).struct.field("mean")


def slower_than_learners() -> Limit:
    """Methods with an inner loop cost at least five times as much per iteration as the fastest learner."""
    seconds = pl.col("iteration_seconds")
    fastest = seconds.filter(pl.col("label") == MABIRDS).min().fill_null(1.0)
    return Limit("time per iteration / MA-BIRDS", seconds / fastest, {"FTL": 5.0, "DLM": 5.0})


def _limit_text(cell: Mapping[str, Any]) -> str:
    return f"{'<=' if cell['at_most'] else '>='} {cell['target']:g}"


COLUMNS = (
    Column("", NAME),
    Column("value", pl.col("value"), number(".3f")),
    Column("target", pl.struct("at_most", "target"), _limit_text),
    Column("", pl.col("met"), lambda met: "met" if met else "missed"),
)
