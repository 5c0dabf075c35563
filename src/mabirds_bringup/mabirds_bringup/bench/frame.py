"""All results of a benchmark as one tidy table, kept beside the report: a row for every number."""

import re
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import polars as pl

from mabirds_bringup.bench.results import CaseResult
from mabirds_core.arrays import Array
from mabirds_core.experiment.assembly import method_names

RESULTS = "results.parquet"

SCHEMA = pl.Schema(
    {
        "group": pl.String,
        "label": pl.String,
        "learner": pl.String,
        "seed": pl.Int64,
        "iteration": pl.Int64,
        "metric": pl.String,
        "value": pl.Float64,
    }
)
"""``learner``: the learner or central method of the case. Rows keep the order of the cases and of iterations."""

LEARNER = ("group", "label", "learner")
"""The columns that tell learners and methods of all cases apart."""


def frame_of(results: Iterable[CaseResult]) -> pl.DataFrame:
    """The rows of all results, with the columns of ``SCHEMA``."""
    return pl.concat([pl.DataFrame(schema=SCHEMA), *map(_frame, results)])


def _frame(result: CaseResult) -> pl.DataFrame:
    case = {"group": result.group, "label": result.label, "learner": result.learner, "seed": result.seed}
    rows = pl.DataFrame(result.rows, schema=["iteration", "metric", "value"], orient="row")
    return rows.select(*(pl.lit(value).alias(name) for name, value in case.items()), pl.all()).cast(SCHEMA)


def read_results(directory: Path) -> pl.DataFrame:
    """The results that an earlier report in ``directory`` was made of; no row where there is no report."""
    file = directory / RESULTS
    return pl.read_parquet(file) if file.exists() else pl.DataFrame(schema=SCHEMA)


def write_results(directory: Path, results: pl.DataFrame) -> None:
    """Keep ``results`` beside the report."""
    results.write_parquet(directory / RESULTS, compression="zstd", compression_level=19)


def is_metric(name: str) -> pl.Expr:
    """Is a row of this metric, a plain number?"""
    return pl.col("metric") == name


def is_entry(name: str) -> pl.Expr:
    """Is a row an entry of this metric, an array?"""
    return pl.col("metric").str.starts_with(f"{name}[")


def array_of(results: pl.DataFrame, name: str) -> Array:
    """The metric ``name`` of one learner with one seed, in the shape that it had; (0,) where it had no entries."""
    of_array = results.filter(is_entry(name))
    if of_array.is_empty():
        return np.zeros(0)
    last = re.findall(r"\d+", of_array["metric"][-1])
    return np.asarray(of_array["value"].to_numpy()).reshape([int(index) + 1 for index in last])


def in_order(results: pl.DataFrame, column: str) -> list[str]:
    """The values of a column, each once, as they come first."""
    return results[column].unique(maintain_order=True).to_list()


def is_learner() -> pl.Expr:
    """Is a row one of a network's learner, and not of a central method?"""
    return ~pl.col("learner").is_in(method_names())


def name() -> pl.Expr:
    """The case, and which of its learners."""
    return pl.when(is_learner()).then(pl.format("{} {}", "label", "learner")).otherwise("label").alias("name")
