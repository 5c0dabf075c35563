"""The benchmark's pictures: the game (2a), learned policies and constraints (2b), rates against iterations (3), ROC."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from mabirds_bringup.bench.discrete.cases import HARD, MAIN, VARIATIONS
from mabirds_bringup.bench.discrete.outcome import Outcome
from mabirds_bringup.bench.figures import draw_band, save_all
from mabirds_bringup.bench.tables import name_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.pictures import draw_map, draw_ways
from mabirds_core.games.patrol.study import patrol_game
from mabirds_expert_player.recorder import expert_streams

SHOWN_DEMONSTRATIONS = 12


def save_figures(main: Experiment, hard: Experiment, outcomes: Sequence[Outcome], directory: Path) -> list[str]:
    """Write the pictures of the groups that there are; returns their names."""
    of = {group: [one for one in outcomes if one.group == group] for group in (MAIN, HARD, VARIATIONS)}
    # All learners of all variations would hide one another; where they differ, the tables tell.
    of[VARIATIONS] = [one for one in of[VARIATIONS] if one.learner == "learner_1"]
    figures = {"game.png": game_figure(main), "game_many_starts.png": game_figure(hard)}
    if of[MAIN]:
        figures["policies.png"] = policies_figure(patrol_game(main), of[MAIN])
        figures["roc.png"] = roc_figure(of[MAIN])
    for group, name in ((MAIN, "rates.png"), (HARD, "rates_many_starts.png"), (VARIATIONS, "variations.png")):
        if of[group]:
            figures[name] = rates_figure(of[group])
    return save_all(figures, directory)


def game_figure(experiment: Experiment) -> Figure:
    """As Figure 2a: the map, starts and goals, and some demonstrations of each expert."""
    game = patrol_game(experiment)
    stream = next(iter(expert_streams(experiment, game).values()))
    shown = [one for one, _ in zip(stream, range(SHOWN_DEMONSTRATIONS), strict=False)]
    figure, axes = plt.subplots(
        1, game.n_experts, figsize=(3 * game.n_experts, 3.2), squeeze=False, layout="constrained"
    )
    for expert, axis in enumerate(axes[0]):
        draw_map(axis, game, expert)
        draw_ways(axis, game, expert, shown)
        axis.set_title(f"expert {expert + 1}", fontsize=9)
    figure.suptitle(f"{experiment.name}: {len(shown)} demonstrations; S starts, G goal, grey obstacles", fontsize=9)
    return figure


def policies_figure(game: PatrolGame, outcomes: Sequence[Outcome]) -> Figure:
    """As Figure 2b: a panel a method and expert for the first seed; blue visits, red crosses learned constraints."""
    ones = [one for one in outcomes if one.seed == outcomes[0].seed]
    size = (2.0 * len(ones), 2.3 * game.n_experts)
    figure, axes = plt.subplots(game.n_experts, len(ones), figsize=size, squeeze=False, layout="constrained")
    for one, column in zip(ones, axes.T, strict=True):
        learned = np.isin(np.arange(len(game.cost_features.names)), one.learned)
        for expert, axis in enumerate(column):
            cells = slice(expert * game.n_cells, (expert + 1) * game.n_cells)
            draw_map(axis, game, expert, np.array(one.visits[expert]), learned[cells])
        column[0].set_title(name_of(one), fontsize=9)
    for expert, axis in enumerate(axes[:, 0]):
        axis.set_ylabel(f"expert {expert + 1}", fontsize=8)
    return figure


def rates_figure(outcomes: Sequence[Outcome]) -> Figure:
    """As Figure 3: SR and CVR against iterations; lines are means over seeds, bands their range."""
    figure, (success, violation) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for name in dict.fromkeys(name_of(one) for one in outcomes):
        ones = [one for one in outcomes if name_of(one) == name]
        draw_band(success, name, [one.success_rate for one in ones])
        draw_band(violation, name, [one.violation_rate for one in ones])
    for axis, title in ((success, "success rate"), (violation, "constraint violation rate")):
        axis.set(xlabel="iterations made, closing rounds last", ylabel=title, ylim=(-0.02, 1.02))
    figure.legend(*success.get_legend_handles_labels(), fontsize=7, loc="outside right upper")
    return figure


def roc_figure(outcomes: Sequence[Outcome]) -> Figure:
    """FPR and FNR against the threshold, and against each other: what any choice of the threshold would give."""
    figure, (rates, roc) = plt.subplots(1, 2, figsize=(10, 3.6), layout="constrained")
    for name in dict.fromkeys(name_of(one) for one in outcomes):
        ones = [one for one in outcomes if name_of(one) == name]
        thresholds, false_positive, false_negative = error_curves(ones)
        line = rates.plot(thresholds, false_positive, label=name, linewidth=1.2)[0]
        rates.plot(thresholds, false_negative, "--", color=line.get_color(), linewidth=1.2)
        roc.plot(false_positive, 1 - false_negative, color=line.get_color(), linewidth=1.2)
    rates.set(xscale="log", xlabel="threshold on -omega", ylabel="FPR (line), FNR (dashed)", ylim=(-0.02, 1.02))
    roc.set(xlabel="FPR", ylabel="1 - FNR", xlim=(-0.02, 0.5), ylim=(-0.02, 1.02))
    figure.legend(*rates.get_legend_handles_labels(), fontsize=7, loc="outside right upper")
    return figure


def error_curves(outcomes: Sequence[Outcome]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Thresholds from 1e-4 to 100 with the mean FPR and FNR over the outcomes at each."""
    thresholds = np.logspace(-4, 2, 121)
    harmless = np.array([one.cost_of_harmless for one in outcomes])
    true = np.array([one.cost_of_true for one in outcomes])
    return (
        thresholds,
        np.array([(harmless > threshold).mean() for threshold in thresholds]),
        np.array([(true <= threshold).mean() for threshold in thresholds]),
    )
