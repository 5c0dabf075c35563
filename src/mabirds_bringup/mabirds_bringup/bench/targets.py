"""What a benchmark is to show, and whether it does: limits on the measures of rows, by label."""

from collections.abc import Mapping
from typing import Any

import polars as pl

from mabirds_bringup.bench.study import TargetSettings
from mabirds_bringup.bench.tables import Column, number

SCHEMA = pl.Schema(
    {"name": pl.String, "value": pl.Float64, "target": pl.Float64, "at_most": pl.Boolean, "met": pl.Boolean}
)


def targets_of(settings: TargetSettings, rows: pl.DataFrame) -> pl.DataFrame:
    """Targets of the rows that have the measure and a limit: name, value, target, at_most, met."""
    of_groups = rows.filter(pl.col("group").is_in(settings.groups))
    if settings.measure not in rows.columns:
        return pl.DataFrame(schema=SCHEMA)
    sides = ((settings.at_most, True), (settings.at_least, False))
    limits = (_limits(settings.measure, by_label, at_most, of_groups) for by_label, at_most in sides)
    return pl.concat([pl.DataFrame(schema=SCHEMA), *map(judged, limits)])


def _limits(measure: str, by_label: Mapping[str, float], at_most: bool, rows: pl.DataFrame) -> pl.DataFrame:  # noqa: FBT001
    return rows.select(
        name=pl.concat_str("group", pl.lit(": "), "name", pl.lit(f" {measure}")),
        value=mean_of(rows, measure).cast(pl.Float64),
        target=pl.col("label").replace_strict(by_label, default=None, return_dtype=pl.Float64),
        at_most=pl.lit(at_most),
    ).drop_nulls()


def judged(targets: pl.DataFrame) -> pl.DataFrame:
    """With ``met``: is the value on the right side of its limit?"""
    value, target = pl.col("value"), pl.col("target")
    return targets.with_columns(met=pl.when("at_most").then(value <= target).otherwise(value >= target))


def mean_of(rows: pl.DataFrame, measure: str) -> pl.Expr:
    """The measure, or the mean of a mean and range."""
    column = pl.col(measure)
    return column.struct.field("mean") if isinstance(rows.schema[measure], pl.Struct) else column


def _limit_text(cell: Mapping[str, Any]) -> str:
    return f"{'<=' if cell['at_most'] else '>='} {cell['target']:g}"


COLUMNS = (
    Column("", pl.col("name")),
    Column("value", pl.col("value"), number(".3f")),
    Column("target", pl.struct("at_most", "target"), _limit_text),
    Column("", pl.col("met"), lambda met: "met" if met else "missed"),
)
