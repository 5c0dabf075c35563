"""One row per learner or method: every metric's value at the end, and times, put together over the seeds."""

import polars as pl

from mabirds_bringup.bench.frame import LEARNER, is_entry, is_learner, is_metric, name

SUCCESS_LEVELS = (0.5, 0.9)

COUNTS = ("gradient_steps", "policy_solves", "peak_memory")
"""Metrics of which the mean over seeds is all that matters."""

PARAMETERS = ("theta", "omega", "seconds")
"""Metrics of which an end value or a mean over entries says nothing."""

VALUE = pl.col("value")


def mean_range(values: pl.Expr) -> pl.Expr:
    """Mean and half of max - min, over seeds, as ``mean`` and ``half_width``; null without values."""
    mean = values.implode().list.mean()  # adds in the order of the seeds: no last digit differs between two reports
    fields = pl.struct(mean=mean, half_width=(values.max() - values.min()) / 2)
    return pl.when(values.count() > 0).then(fields)


def mean_of_all(values: pl.Expr) -> pl.Expr:
    """The mean over seeds; null where a seed has none."""
    return pl.when(values.null_count() == 0).then(values.mean())


def at_end(metric: str) -> pl.Expr:
    """The number after the last iteration, or the mean of an array's entries; null without the metric."""
    return pl.coalesce(VALUE.filter(is_metric(metric)).last(), VALUE.filter(is_entry(metric)).mean())


def at_last_update(metric: str) -> pl.Expr:
    """The number before the closing rounds."""
    return VALUE.filter(is_metric(metric), pl.col("iteration") == last_update()).last()


def last_update() -> pl.Expr:
    """How many updates were made."""
    return pl.col("iteration").filter(is_metric("seconds")).max()


def time_to(level: float) -> pl.Expr:
    """Seconds of updates until SR first is at least ``level``; null where it never is."""
    return _seconds_until(pl.col("iteration").filter(is_metric("success_rate"), pl.col("value") >= level).min())


def time_to_stay(level: float) -> pl.Expr:
    """Seconds of updates until SR stays at least ``level``; null where it does not in the end."""
    below = pl.col("iteration").filter(is_metric("success_rate"), pl.col("value") < level).max().fill_null(-1)
    return _seconds_until(pl.col("iteration").filter(is_metric("success_rate"), pl.col("iteration") > below).min())


def _seconds_until(first: pl.Expr) -> pl.Expr:
    seconds = VALUE.filter(is_metric("seconds"), pl.col("iteration") <= first).sum()
    return pl.when(first.is_not_null()).then(seconds)


def metrics_of(results: pl.DataFrame) -> list[str]:
    """Names of all metrics, arrays without their entries, in order."""
    names = results["metric"].str.replace(r"\[.*", "").unique(maintain_order=True).to_list()
    return [metric for metric in names if metric not in PARAMETERS]


def summarise(results: pl.DataFrame) -> pl.DataFrame:
    """A row per learner or method of each case.

    Parameters
    ----------
    results : DataFrame
        Of ``frame.SCHEMA``.

    Returns
    -------
    DataFrame
        ``name``; a column for each metric at the end, a mean and range over seeds or, of COUNTS, a mean;
        ``updated_violation_rate`` and ``updated_success_rate`` before the closing rounds; ``iterations``;
        ``iteration_seconds``; ``seconds_ratio``, the same over that of the group's fastest learner;
        ``seconds_to_level`` and ``seconds_to_stay`` of SUCCESS_LEVELS.
    """
    metrics = metrics_of(results)
    updated = {f"updated_{rate}": at_last_update(rate) for rate in ("violation_rate", "success_rate")}
    by_seed = results.group_by(*LEARNER, "seed", maintain_order=True).agg(
        **{metric: at_end(metric) for metric in metrics},
        **updated,
        iteration_seconds=VALUE.filter(is_metric("seconds")).mean(),
        seconds_to_level=pl.concat_list([time_to(level) for level in SUCCESS_LEVELS]),
        seconds_to_stay=pl.concat_list([time_to_stay(level) for level in SUCCESS_LEVELS]),
        iterations=last_update(),
    )
    rows = by_seed.group_by(*LEARNER, maintain_order=True).agg(
        **{column: pl.col(column).mean() if column in COUNTS else mean_range(pl.col(column)) for column in metrics},
        **{column: mean_range(pl.col(column)) for column in updated},
        iteration_seconds=pl.col("iteration_seconds").mean(),
        seconds_to_level=_level_by_level(pl.col("seconds_to_level")),
        seconds_to_stay=_level_by_level(pl.col("seconds_to_stay")),
        iterations=pl.col("iterations").first(),
    )
    seconds = pl.col("iteration_seconds")
    fastest = seconds.filter(is_learner()).min().over("group")
    return rows.with_columns(name(), seconds_ratio=seconds / fastest)


def _level_by_level(times: pl.Expr) -> pl.Expr:
    return pl.concat_list([mean_of_all(times.list.get(index)) for index in range(len(SUCCESS_LEVELS))])
