"""Pictures of benchmarks: curves over seeds as queries on the results, and saving."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.bench.frame import LEARNER, in_order, is_metric

DOTS_PER_INCH = 120
ITERATIONS = "iterations made, closing rounds last"
RATES = {"success_rate": "success rate", "violation_rate": "constraint violation rate"}


def save_all(figures: Mapping[str, Figure], directory: Path) -> list[str]:
    """Write figures by file name; returns the names."""
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
    return list(figures)


def draw_band(axis: Axes, results: pl.DataFrame, metric: str, name: str, **style: Any) -> None:
    """The mean over ``results`` by iteration as a line, their range as a band; nothing without the metric."""
    of_metric = results.filter(is_metric(metric)).group_by("iteration", maintain_order=True)
    band = of_metric.agg(mean=pl.col("value").mean(), least=pl.col("value").min(), most=pl.col("value").max())
    if band.is_empty():
        return
    line = axis.plot(band["iteration"], band["mean"], label=name, linewidth=1.2, **style)[0]
    axis.fill_between(band["iteration"], band["least"], band["most"], alpha=0.15, color=line.get_color())


def rates_figure(results: pl.DataFrame, by: str, legend: Mapping[str, Any], height: float = 3.6) -> Figure:
    """SR and CVR against iterations, a line for each value of the column ``by``; actors' rates are dashed."""
    figure, axes = plt.subplots(1, 2, figsize=(10, height), layout="constrained")
    for number, label in enumerate(in_order(results, by)):
        own, colour = results.filter(pl.col(by) == label), f"C{number}"
        for axis, metric in zip(axes, RATES, strict=True):
            draw_band(axis, own, metric, label, color=colour)
            draw_band(axis, own, f"actor_{metric}", f"{label}, actor", color=colour, linestyle="--")
    for axis, title in zip(axes, RATES.values(), strict=True):
        axis.set(xlabel=ITERATIONS, ylabel=title, ylim=(-0.02, 1.02))
    figure.legend(*axes[0].get_legend_handles_labels(), fontsize=7, **legend)
    return figure


def mark_last_updates(figure: Figure, results: pl.DataFrame) -> Figure:
    """A dotted line where closing rounds begin."""
    updates = results.filter(is_metric("seconds")).group_by(LEARNER).agg(pl.col("iteration").max())
    for axis in figure.axes:
        for last in updates["iteration"].unique():
            axis.axvline(last, color="0.5", linestyle=":", linewidth=0.9)
    return figure
