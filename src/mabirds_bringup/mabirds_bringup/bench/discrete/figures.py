"""The benchmark's pictures: the game (2a), learned policies and constraints (2b), rates against iterations (3), ROC."""

from itertools import islice
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
import polars as pl
from matplotlib.figure import Figure

from mabirds_bringup.bench.discrete.cases import HARD, MAIN, VARIATIONS
from mabirds_bringup.bench.figures import rates_figure, save_all
from mabirds_bringup.bench.frame import array_of, in_order, is_entry, name
from mabirds_core.arrays import Vector
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.pictures import draw_map, draw_paths
from mabirds_core.games.patrol.study import patrol_game
from mabirds_expert_player.recorder import expert_streams

SHOWN_DEMONSTRATIONS = 12
LEGEND: dict[str, Any] = {"loc": "outside right upper"}


def save_figures(main: Experiment, hard: Experiment, results: pl.DataFrame, directory: Path) -> list[str]:
    """Write the pictures of the groups that there are; returns their names."""
    of = {group: results.filter(group=group).with_columns(name()) for group in (MAIN, HARD, VARIATIONS)}
    # All learners of all variations would hide one another; where they differ, the tables tell.
    of[VARIATIONS] = of[VARIATIONS].filter(learner="learner_1")
    figures = {"game.png": game_figure(main), "game_many_starts.png": game_figure(hard)}
    if len(of[MAIN]):
        figures["policies.png"] = policies_figure(patrol_game(main), of[MAIN])
        figures["roc.png"] = roc_figure(of[MAIN])
    for group, file in ((MAIN, "rates.png"), (HARD, "rates_many_starts.png"), (VARIATIONS, "variations.png")):
        if len(of[group]):
            figures[file] = rates_figure(of[group], "name", LEGEND)
    return save_all(figures, directory)


def game_figure(experiment: Experiment) -> Figure:
    """As Figure 2a: the map, starts and goals, and some demonstrations of each expert."""
    game = patrol_game(experiment)
    stream = next(iter(expert_streams(experiment, game).values()))
    shown = list(islice(stream, SHOWN_DEMONSTRATIONS))
    figure, axes = plt.subplots(
        1, game.n_experts, figsize=(3 * game.n_experts, 3.2), squeeze=False, layout="constrained"
    )
    for expert, axis in enumerate(axes[0]):
        draw_map(axis, game, expert)
        draw_paths(axis, game, expert, shown)
        axis.set_title(f"expert {expert + 1}", fontsize=9)
    figure.suptitle(f"{experiment.name}: {len(shown)} demonstrations; S starts, G goal, grey obstacles", fontsize=9)
    return figure


def policies_figure(game: PatrolGame, results: pl.DataFrame) -> Figure:
    """As Figure 2b: a panel per method and expert for the first seed; blue visits, red crosses learned constraints."""
    of_seed = results.filter(pl.col("seed") == pl.col("seed").first())
    names = in_order(of_seed, "name")
    size = (2.0 * len(names), 2.3 * game.n_experts)
    figure, axes = plt.subplots(game.n_experts, len(names), figsize=size, squeeze=False, layout="constrained")
    for title, column in zip(names, axes.T, strict=True):
        own = of_seed.filter(name=title)
        visited, learned = array_of(own, "visits"), array_of(own, "learned") > 0
        for expert, axis in enumerate(column):
            cells = slice(expert * game.n_cells, (expert + 1) * game.n_cells)
            draw_map(axis, game, expert, visited[expert], learned[cells])
        column[0].set_title(title, fontsize=9)
    for expert, axis in enumerate(axes[:, 0]):
        axis.set_ylabel(f"expert {expert + 1}", fontsize=8)
    return figure


def roc_figure(results: pl.DataFrame) -> Figure:
    """FPR and FNR against the threshold, and against each other: what any choice of the threshold would give."""
    figure, (rates, roc) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for title in in_order(results, "name"):
        thresholds, false_positive, false_negative = error_curves(results.filter(name=title))
        line = rates.plot(thresholds, false_positive, label=title, linewidth=1.2)[0]
        rates.plot(thresholds, false_negative, "--", color=line.get_color(), linewidth=1.2)
        roc.plot(false_positive, 1 - false_negative, color=line.get_color(), linewidth=1.2)
    rates.set(xscale="log", xlabel="threshold on -omega", ylabel="FPR (line), FNR (dashed)", ylim=(-0.02, 1.02))
    roc.set(xlabel="FPR", ylabel="1 - FNR", xlim=(-0.02, 0.5), ylim=(-0.02, 1.02))
    figure.legend(*rates.get_legend_handles_labels(), fontsize=7, **LEGEND)
    return figure


def error_curves(results: pl.DataFrame) -> tuple[Vector, Vector, Vector]:
    """Thresholds from 1e-4 to 100 with the mean FPR and FNR over learners and seeds at each, all of one shape."""
    thresholds = np.logspace(-4, 2, 121)
    harmless, true = (
        results.filter(is_entry(costs))["value"].to_numpy()[:, None] for costs in ("cost_of_harmless", "cost_of_true")
    )
    return thresholds, (harmless > thresholds).mean(axis=0), (true <= thresholds).mean(axis=0)
