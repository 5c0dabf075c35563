"""Pictures of a run: what the learned policies do, what counts as forbidden or costs, how learning went."""

from collections.abc import Sequence
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.evaluate.evaluation import Evaluation
from mabirds_bringup.report.delivery_figure import delivery, delivery_figure
from mabirds_bringup.report.said import Said
from mabirds_bringup.report.schedule_figure import schedule_figure
from mabirds_core.consensus.schedule import DeliveredEdges
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.games.whole_game import Game, Learned

DOTS_PER_INCH = 110

DELIVERED = "delivered.png"

MANY = 60
"""Judged points beyond which markers would hide the line."""


def save_figures(
    experiment: Experiment, game: Game, history: History, evaluation: Evaluation, directory: Path
) -> dict[str, str]:
    """Write map.png, curves.png and schedule.png; returns their names with what they show."""
    learned, threshold = learned_by(history, evaluation), experiment.constraint_threshold
    picture = game.figure(learned, threshold, experiment.seed)
    figures = {
        "map.png": (picture, "What each learner takes for forbidden, and how experts would act by it."),
        "curves.png": (
            curves_figure(evaluation),
            "How learning went: rates, and how far learners are apart.",
        ),
    }
    if set(history) <= set(experiment.learners) and len(history) > 1:
        words = "Who was to hear whom: the slots of the edge schedule, in turn."
        figures["schedule.png"] = (schedule_figure(experiment.edge_schedule), words)
    for name, (figure, _) in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
    return {name: words for name, (_, words) in figures.items()}


def save_delivery(experiment: Experiment, edges: DeliveredEdges, told: Said, directory: Path) -> dict[str, str]:
    """Write delivered.png; returns its name with what it shows."""
    rounds = experiment.iterations + experiment.closing_rounds
    figure = delivery_figure(*delivery(experiment.edge_schedule, edges, told.waits, rounds))
    figure.savefig(directory / DELIVERED, dpi=DOTS_PER_INCH, bbox_inches="tight")
    plt.close(figure)
    return {DELIVERED: "Who really heard whom: what became of each exchange of parameters, by iteration."}


def learned_by(history: History, evaluation: Evaluation) -> dict[str, Learned]:
    """What each learner or method of ``history`` ended with."""
    return {
        name: Learned(evaluation.policies[name], parameters[-1].omega, evaluation.constraints[name].learned)
        for name, parameters in history.items()
    }


def curves_figure(evaluation: Evaluation) -> Figure:
    """Success and violation rates where they were judged, and the consensus distances, against iterations."""
    figure, (rates, distances) = plt.subplots(1, 2, figsize=(11, 3.6), layout="constrained")
    if all(row.success_rate is None for row in evaluation.rows):
        rates.remove()  # nobody knows what violations are
    else:
        _draw_rates(rates, evaluation)
    distances.plot(evaluation.consensus_theta, label="theta")
    distances.plot(evaluation.consensus_omega, label="omega")
    ended = max(evaluation.consensus_theta[-1], evaluation.consensus_omega[-1])
    distances.set(
        xlabel="demonstrations learned", ylabel="distance from the mean of all", title=f"apart by {ended:.3g}"
    )
    legend_beside(distances)
    return figure


def _draw_rates(rates: Axes, evaluation: Evaluation) -> None:
    ends = []
    for name in evaluation.constraints:
        rows = evaluation.of(name)
        iterations, mark = [row.iteration - 1 for row in rows], marker_of(rows)
        success = np.array([row.success_rate for row in rows], dtype=np.float64)
        violation = np.array([row.violation_rate for row in rows], dtype=np.float64)
        line = rates.plot(iterations, success, mark, ms=3, label=f"{name} SR")[0]
        broken = mark.replace("-", "--")
        rates.plot(iterations, violation, broken, ms=3, color=line.get_color(), label=f"{name} CVR")
        ends.append(success[-1])
    title = f"success ends at {min(ends):.3f}"
    rates.set(xlabel="demonstrations learned", ylabel="rate", ylim=(-0.02, 1.02), title=title)
    legend_beside(rates)


def marker_of(rows: Sequence[object]) -> str:
    """A line with a marker at each judged point, as long as they can be told apart."""
    return "o-" if len(rows) <= MANY else "-"


def legend_beside(axis: Axes) -> None:
    """A legend that covers no curve."""
    axis.legend(fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
