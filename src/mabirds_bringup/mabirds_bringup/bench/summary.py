"""One row per learner or method: measures, each asked of the results of a seed and then put together over the seeds."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import polars as pl

from mabirds_bringup.bench.frame import LEARNER, is_entry, is_metric, name

SUCCESS_LEVELS = (0.5, 0.9)

VALUE = pl.col("value")


@dataclass(frozen=True)
class MeanRange:
    """A mean over seeds and half the range around it."""

    mean: float
    half_width: float

    def __str__(self) -> str:
        return f"{self.mean:.3f} ± {self.half_width:.3f}"


def mean_range(values: pl.Expr) -> pl.Expr:
    """Mean and half of max - min, over seeds, as the fields of ``MeanRange``; null without values."""
    mean = values.implode().list.mean()  # adds in the order of the seeds: no last digit differs between two reports
    fields = pl.struct(mean=mean, half_width=(values.max() - values.min()) / 2)
    return pl.when(values.count() > 0).then(fields)


def mean_of_all(values: pl.Expr) -> pl.Expr:
    """The mean over seeds; null where a seed has none."""
    return pl.when(values.null_count() == 0).then(values.mean())


@dataclass(frozen=True)
class Measure:
    """A figure of a row: what to ask the results of one seed, and how the seeds' answers become one."""

    of_seed: pl.Expr
    over_seeds: Callable[[pl.Expr], pl.Expr] = mean_range


def summarise(results: pl.DataFrame, measures: Mapping[str, Measure]) -> pl.DataFrame:
    """One row per learner or method, with ``name`` and a column per measure."""
    by_seed = results.group_by(*LEARNER, "seed", maintain_order=True).agg(
        **{column: measure.of_seed for column, measure in measures.items()}
    )
    rows = by_seed.group_by(*LEARNER, maintain_order=True).agg(
        **{column: measure.over_seeds(pl.col(column)) for column, measure in measures.items()}
    )
    return rows.with_columns(name())


def at_end(metric: str) -> pl.Expr:
    """The number after the last iteration; null without the metric."""
    return VALUE.filter(is_metric(metric)).last()


def at_last_update(metric: str) -> pl.Expr:
    """The number before the closing rounds."""
    return VALUE.filter(is_metric(metric), pl.col("iteration") == last_update()).last()


def last_update() -> pl.Expr:
    """How many updates were made."""
    return pl.col("iteration").filter(is_metric("seconds")).max()


def share_above_zero(metric: str) -> pl.Expr:
    """The share of an array's entries that are more than 0; null without entries."""
    return (VALUE.filter(is_entry(metric)) > 0).mean()


def time_to(level: float) -> pl.Expr:
    """Seconds of updates until SR first is at least ``level``; null where it never is."""
    first = pl.col("iteration").filter(is_metric("success_rate"), pl.col("value") >= level).min()
    seconds = VALUE.filter(is_metric("seconds"), pl.col("iteration") <= first).sum()
    return pl.when(first.is_not_null()).then(seconds)


def _level_by_level(times: pl.Expr) -> pl.Expr:
    return pl.concat_list([mean_of_all(times.list.get(index)) for index in range(len(SUCCESS_LEVELS))])


MEASURES: Mapping[str, Measure] = {
    "violation_rate": Measure(at_end("violation_rate")),
    "success_rate": Measure(at_end("success_rate")),
    "iteration_seconds": Measure(VALUE.filter(is_metric("seconds")).mean(), pl.Expr.mean),
    "seconds_to_level": Measure(pl.concat_list([time_to(level) for level in SUCCESS_LEVELS]), _level_by_level),
    "gradient_steps": Measure(at_end("gradient_steps"), pl.Expr.mean),
    "policy_solves": Measure(at_end("policy_solves"), pl.Expr.mean),
    "iterations": Measure(last_update(), pl.Expr.first),
}
"""What every benchmark shows of a row. Times in seconds."""
