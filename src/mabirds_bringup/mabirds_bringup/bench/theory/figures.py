"""Pictures: consensus against the exponents of the steps, sums over iterations, hard constraints."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.bench.theory.cases import BASE, LARGE, RATES, SETTINGS, etas_text
from mabirds_core.arrays import Array

DOTS_PER_INCH = 110
Labelled = Mapping[str, tuple[str, str]]
"""Group and label of a case by what the legend calls it."""


def save_figures(results: pl.DataFrame, directory: Path) -> list[str]:
    """Write the pictures; returns their names."""
    names = []
    for name, figure in _figures(results):
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
        names.append(name)
    return names


def _figures(results: pl.DataFrame) -> Iterator[tuple[str, Figure]]:
    yield "consensus.png", consensus_figure(results)
    yield "sums.png", sums_figure(results)
    yield "networks.png", networks_figure(results)
    yield "hard.png", hard_figure(results)


def _panels(count: int, title: str) -> tuple[Figure, Sequence[Axes]]:
    figure, axes = plt.subplots(1, count, figsize=(4 * count + 2.2, 3.6), layout="constrained")
    figure.suptitle(title)
    return figure, axes


def _draw(axis: Axes, results: pl.DataFrame, metric: str, cases: Labelled) -> None:
    """Geometric mean over seeds by iteration, and the seeds' range."""
    for number, (name, (group, label)) in enumerate(cases.items()):
        values = _by_seed(results.filter(group=group, label=label, metric=metric))
        iterations, positive = values[:, 0], np.where(values[:, 1:] > 0, values[:, 1:], np.nan)
        style: dict[str, Any] = {"color": f"C{number}", "marker": ".", "markersize": 4, "linewidth": 1.0}
        axis.plot(iterations, np.exp(np.log(positive).mean(axis=1)), label=name, **style)
        axis.fill_between(iterations, positive.min(axis=1), positive.max(axis=1), color=f"C{number}", alpha=0.15)
    axis.set(xscale="log", yscale="log", xlabel="iteration n")


def _by_seed(results: pl.DataFrame) -> Array:
    """Iterations, then a column of values per seed."""
    wide = results.pivot("seed", index="iteration", values="value").sort("iteration")
    return np.asarray(wide.to_numpy(), dtype=np.float64)


def _guide(axis: Axes, exponent: float, number: int) -> None:
    """A dashed power law through the curve's last point."""
    x, y = (np.asarray(values, dtype=np.float64) for values in axis.lines[number].get_data())
    axis.plot(x, y[-1] * (x / x[-1]) ** exponent, linestyle="--", linewidth=0.8, color=f"C{number}")


def consensus_figure(results: pl.DataFrame) -> Figure:
    """Each parameter's disagreement follows its own step."""
    figure, axes = _panels(
        3, "Each parameter's disagreement falls with its own step (dashed: theta n^-eta2, omega n^-eta1)"
    )
    cases = {f"eta1, eta2 = {case.label}": (case.group, case.label) for case in RATES}
    implied = {
        "theta": [-e.eta2 for e in SETTINGS],
        "omega": [-e.eta1 for e in SETTINGS],
        "policy": [-min(e) for e in SETTINGS],
    }
    for axis, (metric, exponents) in zip(axes, implied.items(), strict=True):
        _draw(axis, results, metric, cases)
        for number, exponent in enumerate(exponents):
            _guide(axis, exponent, number)
        axis.set(ylabel=f"disagreement of {metric}")
    _legend(figure, axes[0])
    return figure


def sums_figure(results: pl.DataFrame) -> Figure:
    """Window regret stays at its floor; the population gradient falls."""
    figure, axes = _panels(
        2, "The window's regret ends at the demonstrations' variance / l; the population gradient falls"
    )
    windows = {f"l = {length}": ("window", f"l = {length}") for length in (10, 100)}
    cases = {
        "l = 1": (BASE.group, BASE.label),
        **windows,
        f"l = 1, steps {LARGE:g}": ("large", f"{BASE.label}, steps {LARGE:g}"),
        "default rule": ("default", "soft constraints"),
    }
    for axis, (metric, name) in zip(axes, (("regret", "window"), ("population", "population")), strict=True):
        _draw(axis, results, metric, cases)
        axis.set(ylabel=f"mean squared gradient, {name}")
    _legend(figure, axes[0])
    return figure


def networks_figure(results: pl.DataFrame) -> Figure:
    """Schedules shift disagreement, and leave its exponent."""
    figure, axes = _panels(
        2, f"A larger B raises disagreement and leaves its exponent, eta1 = eta2 = {BASE.label[1:5]}"
    )
    labels = results.filter(group="schedule")["label"].unique(maintain_order=True)
    cases = {"ring": (BASE.group, BASE.label), **{label: ("schedule", label) for label in labels}}
    for axis, metric in zip(axes, ("theta", "policy"), strict=True):
        _draw(axis, results, metric, cases)
        axis.set(ylabel=f"disagreement of {metric}")
    _legend(figure, axes[0])
    return figure


def hard_figure(results: pl.DataFrame) -> Figure:
    """Free omega grows for ever and violations sublinearly; with an optimum, violations grow as N."""
    figure, axes = _panels(2, "Hard constraints: free omega has no optimum to go to; with one, violations go on")
    free = {f"free, {etas_text(etas)}": ("hard", f"free, {etas_text(etas)}") for etas in SETTINGS}
    remedied = {name: ("hard", f"{name}, {BASE.label}") for name in ("bounded", "regularised")}
    cases = {**free, **remedied, "default rule": ("default", "hard constraints")}
    for axis, metric in zip(axes, ("largest_cost", "violation"), strict=True):
        _draw(axis, results, metric, cases)
    axes[0].set(ylabel="largest -omega", yscale="linear")
    axes[1].set(ylabel="cumulated cost")
    _legend(figure, axes[0])
    return figure


def _legend(figure: Figure, axis: Axes) -> None:
    figure.legend(*axis.get_legend_handles_labels(), loc="outside right upper", fontsize=8)
