"""Pictures of benchmarks: games and what was learned of them, rates and agreement over iterations, thresholds."""

from collections.abc import Iterator, Mapping
from itertools import chain, islice
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import polars as pl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.bench.frame import LEARNER, array_of, in_order, is_learner, is_metric, name
from mabirds_bringup.bench.outcome import drawn_streams
from mabirds_bringup.bench.study import Case, LoadedStudy
from mabirds_bringup.bench.summary import summarise
from mabirds_bringup.evaluate.constraints import learned_constraints
from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Mask, Vector
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.truth import known_constraints
from mabirds_core.games.whole_game import Learned
from mabirds_core.metrics.constraints import by_threshold, constraint_errors

DOTS_PER_INCH = 120
ITERATIONS = "iterations made, closing rounds last"
RATES = {"success_rate": "success rate", "violation_rate": "constraint violation rate"}
DISTANCES = {f"consensus_{part}": f"consensus distance of {part}" for part in ("theta", "omega")}
OUTCOMES = {
    "success_rate": "success rate",
    "late_success": "least late success rate",
    "held_out_nats": "held-out log likelihood [nats]",
}
NATS = {"held_out_nats": "held-out log likelihood [nats per demonstration]"}
MAX_DEMONSTRATIONS = 40
FEW = 30
"""Points of a line that are marked, each."""
THRESHOLDS = np.logspace(-4, 2, 121)
LEGEND: dict[str, Any] = {"loc": "outside right upper", "fontsize": 7}


def save_figures(study: LoadedStudy, results: pl.DataFrame, directory: Path) -> list[str]:
    """Write the pictures of a study by file name; returns the names."""
    names = []
    for file, figure in study_figures(study, results):
        figure.savefig(directory / file, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
        names.append(file)
    return names


def study_figures(study: LoadedStudy, results: pl.DataFrame) -> Iterator[tuple[str, Figure]]:
    """The games with demonstrations, then the declared pictures of each group that there is, by file name."""
    for key, experiment in study.experiments.items():
        if figure := game_figure(experiment):
            yield f"game_{key}.png", figure
    for group, settings in study.settings.groups.items():
        of_group = results.filter(group=group).with_columns(name())
        cases = {case.label: case for case in study.cases if case.group == group}
        shown = of_group.filter(pl.col("label").is_in(settings.shown or list(cases)))
        for kind in settings.pictures if len(of_group) else ():
            yield f"{kind}_{group}.png", _figure(kind, cases, of_group, shown)


def _figure(kind: str, cases: Mapping[str, Case], of_group: pl.DataFrame, shown: pl.DataFrame) -> Figure:
    if kind == "learned":
        return learned_figure(cases, shown)
    if kind == "thresholds":
        return thresholds_figure(known_constraints(build_game(next(iter(cases.values())).experiment)), shown)
    if kind == "rates":
        return curves_figure(of_group, RATES, ylim=(-0.02, 1.02))
    if kind == "likelihood":
        return curves_figure(of_group, NATS)
    if kind == "effort":
        return effort_figure(summarise(of_group))
    return curves_figure(of_group.filter(is_learner()), DISTANCES)


def game_figure(experiment: Experiment) -> Figure | None:
    """The game with demonstrations of all learners."""
    game, each = build_game(experiment), -(-MAX_DEMONSTRATIONS // len(experiment.learners))
    few = experiment.model_copy(update={"iterations": min(each, experiment.iterations)})
    streams = drawn_streams(few, game)
    shown = list(islice(chain.from_iterable(streams.values()), MAX_DEMONSTRATIONS))
    figure: Figure | None = game.demonstrations_figure(stacked(shown))
    return figure


def learned_figure(cases: Mapping[str, Case], results: pl.DataFrame) -> Figure:
    """The game's picture of what learners and methods ended with, for the first seed; constraints as they are told."""
    of_seed = results.filter(pl.col("seed") == pl.col("seed").first())
    learned = dict[str, Learned]()
    for (label, learner, title), own in of_seed.group_by("label", "learner", "name", maintain_order=True):
        experiment = cases[str(label)].seeded(int(own["seed"][0]))
        game, at = build_game(experiment), Parameters(array_of(own, "theta"), array_of(own, "omega"))
        constraints = learned_constraints(experiment, str(learner), at, drawn_streams(experiment, game), game).learned
        policy = evaluation_policy(experiment, str(learner), game)(at)
        learned[str(title)] = Learned(policy, at.omega, constraints)
    figure: Figure = game.figure(learned, experiment.constraint_threshold, experiment.seed)
    return figure


def curves_figure(results: pl.DataFrame, titles: Mapping[str, str], **limits: Any) -> Figure:
    """A panel per metric and a line per case against iterations; actors' are dashed, closing rounds begin dotted."""
    figure, axes = plt.subplots(1, len(titles), figsize=(5 * len(titles), 3.8), layout="constrained", squeeze=False)
    for axis, (metric, title) in zip(axes[0], titles.items(), strict=True):
        for number, label in enumerate(in_order(results, "label")):
            of_case, colour = results.filter(label=label), f"C{number}"
            draw_band(axis, of_case, metric, label, color=colour)
            draw_band(axis, of_case, f"actor_{metric}", f"{label}, actor", color=colour, linestyle="--")
        axis.set(xlabel=ITERATIONS, ylabel=title, **limits)
        mark_last_updates(axis, results)
    figure.legend(*axes[0][0].get_legend_handles_labels(), **LEGEND)
    return figure


def effort_figure(rows: pl.DataFrame) -> Figure:
    """What an iteration takes and leads to, a marker per learner or method; a line joins those of one method."""
    measures = {measure: title for measure, title in OUTCOMES.items() if measure in rows.columns}
    figure, axes = plt.subplots(1, len(measures), figsize=(10, 3.8), layout="constrained", squeeze=False)
    method = pl.col("label").str.extract(r"^([^,]+)").alias("method")
    for axis, (measure, title) in zip(axes[0], measures.items(), strict=True):
        for (label,), own in rows.with_columns(method).group_by("method", maintain_order=True):
            means, widths = (own[measure].struct.field(part).to_numpy() for part in ("mean", "half_width"))
            axis.errorbar(own["iteration_seconds"], means, yerr=widths, marker="o", markersize=4, label=label)
        axis.set(xscale="log", xlabel="seconds per iteration and learner", ylabel=title)
    figure.legend(*axes[0][0].get_legend_handles_labels(), **LEGEND)
    return figure


def draw_band(axis: Axes, results: pl.DataFrame, metric: str, label: str, **style: Any) -> None:
    """The mean over ``results`` by iteration as a line, their range as a band; nothing without the metric."""
    by_iteration = results.filter(is_metric(metric)).group_by("iteration", maintain_order=True)
    band = by_iteration.agg(mean=pl.col("value").mean(), least=pl.col("value").min(), most=pl.col("value").max())
    if band.is_empty():
        return
    shape: dict[str, Any] = {"linewidth": 1.2, "marker": "o" if len(band) < FEW else None, "markersize": 3, **style}
    line = axis.plot(band["iteration"], band["mean"], label=label, **shape)[0]
    axis.fill_between(band["iteration"], band["least"], band["most"], alpha=0.15, color=line.get_color())


def mark_last_updates(axis: Axes, results: pl.DataFrame) -> None:
    """A dotted line where closing rounds begin."""
    updates = results.filter(is_metric("seconds")).group_by(LEARNER).agg(pl.col("iteration").max())
    for last in updates["iteration"].unique():
        axis.axvline(last, color="0.5", linestyle=":", linewidth=0.9)


def thresholds_figure(truth: Mask, results: pl.DataFrame) -> Figure:
    """FPR and FNR against the threshold, and against each other: what any choice of the threshold would give."""
    figure, (rates, roc) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    for title in in_order(results, "name"):
        false_positive, false_negative = error_curves(truth, results.filter(name=title))
        line = rates.plot(THRESHOLDS, false_positive, label=title, linewidth=1.2)[0]
        rates.plot(THRESHOLDS, false_negative, "--", color=line.get_color(), linewidth=1.2)
        roc.plot(false_positive, 1 - false_negative, color=line.get_color(), linewidth=1.2)
    rates.set(xscale="log", xlabel="threshold on -omega", ylabel="FPR (line), FNR (dashed)", ylim=(-0.02, 1.02))
    roc.set(xlabel="FPR", ylabel="1 - FNR", xlim=(-0.02, 0.5), ylim=(-0.02, 1.02))
    figure.legend(*rates.get_legend_handles_labels(), **LEGEND)
    return figure


def error_curves(truth: Mask, results: pl.DataFrame) -> tuple[Vector, Vector]:
    """Mean FPR and FNR over learners and seeds at each of THRESHOLDS."""
    omegas = [array_of(own, "omega") for _, own in results.group_by("learner", "seed", maintain_order=True)]
    errors = [
        [constraint_errors(by_threshold(omega, threshold), truth)[:2] for threshold in THRESHOLDS] for omega in omegas
    ]
    false_positive, false_negative = np.mean(errors, axis=0).T
    return false_positive, false_negative
