"""Constraints of all problems at any level: how many called ones are false, how many of the decidable are found."""

import matplotlib.pyplot as plt
import polars as pl
from matplotlib.figure import Figure

from mabirds_bringup.bench.behaviour.trial import COUNTING, LEVELS, MABIRDS


def constraint_rates(rows: pl.DataFrame) -> pl.DataFrame:
    """By method: false discoveries of all that was called, share of the decidable that was found, mean AUC.

    Where nothing was called, nothing is false; where nothing was decidable, nothing was missed.
    """
    return rows.group_by("method", maintain_order=True).agg(
        _share("false", "called").alias("false_discovery_rate"),
        (1 - _share(pl.col("decidable") - pl.col("found"), "decidable")).alias("found"),
        pl.sum("called_used"),
        pl.mean("auc"),
        pl.sum("called"),
    )


def _share(part: str | pl.Expr, whole: str) -> pl.Expr:
    """Sum of ``part`` over that of ``whole``; 0 over nothing."""
    return (pl.col(part) if isinstance(part, str) else part).sum() / pl.max_horizontal(pl.sum(whole), 1)


def rates_by_level(rows: pl.DataFrame) -> pl.DataFrame:
    """Of the test and of the counting rule: ``method``, ``level``, ``false_discovery_rate``, ``found``, ``called``."""
    own = rows.filter(pl.col("method").is_in([MABIRDS, COUNTING])).with_columns(level=pl.lit(list(LEVELS)))
    counts = ("level", "called_at", "false_at", "found_at")
    by_level = own.select("method", "decidable", "auc", "called_used", *counts).explode(*counts)
    renamed = by_level.rename({"called_at": "called", "false_at": "false", "found_at": "found"})
    return pl.concat(
        constraint_rates(of_level).select("method", pl.lit(level).alias("level"), "called", *SHOWN)
        for (level,), of_level in renamed.group_by("level", maintain_order=True)
    ).sort("method", "level", maintain_order=True)


SHOWN = ("false_discovery_rate", "found")


def trade_off_figure(rows: pl.DataFrame) -> Figure:
    """Share found against false discoveries, a marker for each level, a circle for the one that is used."""
    figure, axis = plt.subplots(figsize=(6, 3.4), layout="constrained")
    own = constraint_rates(rows)
    for (method,), of in rates_by_level(rows).group_by("method", maintain_order=True):
        line = axis.plot(of["false_discovery_rate"], of["found"], marker=".", label=str(method))[0]
        used = own.filter(method=method)
        axis.plot(*(used[column] for column in SHOWN), "o", markersize=9, fillstyle="none", color=line.get_color())
    axis.set(xlabel="false discovery rate", ylabel="share of the decidable found", xlim=(0, None))
    figure.legend(loc="outside right upper", fontsize=8)
    axis.set_title("Constraints at any confidence; circles: at the one that is used", fontsize=10)
    return figure
