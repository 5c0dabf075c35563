"""Pictures of a run: what the learned policies do, what counts as forbidden or costs, how learning went."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.evaluate.evaluation import Evaluation
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.games.whole_game import Learned

DOTS_PER_INCH = 110


def save_figures(experiment: Experiment, history: History, evaluation: Evaluation, directory: Path) -> list[str]:
    """Write map.png and curves.png; returns their names."""
    learned, threshold = learned_by(experiment, history, evaluation), experiment.constraint_threshold
    picture = build_game(experiment).figure(learned, threshold, experiment.seed)
    figures = {"map.png": picture, "curves.png": curves_figure(evaluation)}
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
    return list(figures)


def learned_by(experiment: Experiment, history: History, evaluation: Evaluation) -> dict[str, Learned]:
    """What each learner or method of ``history`` ended with."""
    game = build_game(experiment)
    return {
        name: Learned(
            evaluation_policy(experiment, name, game)(parameters[-1]),
            parameters[-1].omega,
            evaluation.constraints[name].learned,
        )
        for name, parameters in history.items()
    }


def curves_figure(evaluation: Evaluation) -> Figure:
    """Success and violation rates, where the truth is known, and the consensus distances, against iterations."""
    figure, (rates, distances) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    if all(row.success_rate is None for row in evaluation.rows):
        rates.remove()  # nobody knows what violations are
    else:
        _draw_rates(rates, evaluation)
    distances.plot(evaluation.consensus_theta, label="theta")
    distances.plot(evaluation.consensus_omega, label="omega")
    distances.set(xlabel="demonstrations learned", ylabel="consensus distance")
    distances.legend(fontsize=7)
    return figure


def _draw_rates(rates: Axes, evaluation: Evaluation) -> None:
    for name in evaluation.constraints:
        rows = evaluation.of(name)
        iterations = [row.iteration - 1 for row in rows]
        success = np.array([row.success_rate for row in rows], dtype=np.float64)
        violation = np.array([row.violation_rate for row in rows], dtype=np.float64)
        line = rates.plot(iterations, success, label=f"{name} SR")[0]
        rates.plot(iterations, violation, "--", color=line.get_color(), label=f"{name} CVR")
    rates.set(xlabel="demonstrations learned", ylabel="rate", ylim=(-0.02, 1.02))
    rates.legend(fontsize=7)
