"""Pictures of a patrol run: where the learned policies walk, what counts as forbidden, how learning went."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.evaluation import Evaluation
from mabirds_core.algorithm import Parameters
from mabirds_core.arrays import weighted_counts
from mabirds_core.assembly import build_game, build_learner
from mabirds_core.experiment import Experiment
from mabirds_core.games.patrol import PatrolGame
from mabirds_core.metrics import learned_constraints
from mabirds_core.policies.occupancy import occupancy_measure
from mabirds_core.simulate import History

DOTS_PER_INCH = 110


def save_figures(experiment: Experiment, history: History, evaluation: Evaluation, directory: Path) -> list[str]:
    """Write map.png and curves.png; returns their names."""
    figures = {"map.png": map_figure(experiment, history), "curves.png": curves_figure(experiment, evaluation)}
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
    return list(figures)


def map_figure(experiment: Experiment, history: History) -> Figure:
    """A panel a learner and expert: visitation in blue, learned constraints as red crosses, obstacles in grey."""
    game, names = build_game(experiment), experiment.learners
    size = (2.6 * game.n_experts + 0.8, 2.8 * len(names))
    figure, axes = plt.subplots(len(names), game.n_experts, figsize=size, squeeze=False, layout="constrained")
    for name, row in zip(names, axes, strict=True):
        visits = _visits(experiment, game, name, history[name][-1])
        learned = learned_constraints(history[name][-1].omega, experiment.constraint_threshold)
        for expert, axis in enumerate(row):
            cells = slice(expert * game.n_cells, (expert + 1) * game.n_cells)
            _draw_map(axis, game, expert, visits[expert], learned[cells])
            axis.set_title(f"{name}: expert {expert + 1}", fontsize=9)
        row[0].set_ylabel(_joint_constraints(learned), fontsize=7)
    figure.suptitle("learned policy (blue), learned constraints (red), true obstacles (grey)", fontsize=10)
    return figure


def _visits(experiment: Experiment, game: PatrolGame, name: str, parameters: Parameters) -> np.ndarray:
    """Discounted visitation of each expert's cells under the learned policy, shape (N_E, n)."""
    policy = build_learner(experiment, name, game).finder.find(*parameters)
    of_state = occupancy_measure(game, policy).sum(axis=1)
    cells = game.cells(np.arange(game.n_states))
    return np.stack([weighted_counts(own, of_state, game.n_cells) for own in cells])


def _draw_map(axis: Axes, game: PatrolGame, expert: int, visits: np.ndarray, learned: np.ndarray) -> None:
    shape = (game.height, game.width)
    axis.imshow(np.sqrt(visits).reshape(shape), cmap="Blues", vmin=0, vmax=0.6)
    obstacles = np.ma.masked_where(~game.obstacles, np.ones(game.n_cells)).reshape(shape)
    axis.imshow(obstacles, cmap="Greys", vmin=0, vmax=2.5)
    rows, columns = np.divmod(np.flatnonzero(learned), game.width)
    axis.scatter(columns, rows, marker="x", color="tab:red", s=28)
    for start in game.settings.starts[:8]:
        axis.annotate("S", (start[expert][1], start[expert][0]), ha="center", va="center", fontsize=8)
    goal = game.settings.goals[expert]
    axis.annotate("G", (goal[1], goal[0]), ha="center", va="center", fontsize=8, color="white", weight="bold")
    axis.set_xticks([])
    axis.set_yticks([])


def _joint_constraints(learned: np.ndarray) -> str:
    found = [name for name, is_learned in zip(("sharing", "swapping"), learned[-2:], strict=True) if is_learned]
    return "joint constraints: " + (", ".join(found) or "none")


def curves_figure(experiment: Experiment, evaluation: Evaluation) -> Figure:
    """Success and violation rates, and the consensus distances, against iterations."""
    figure, (rates, distances) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for name in experiment.learners:
        rows = evaluation.of(name)
        iterations = [row.iteration - 1 for row in rows]
        line = rates.plot(iterations, [row.success_rate for row in rows], label=f"{name} SR")[0]
        rates.plot(iterations, [row.violation_rate for row in rows], "--", color=line.get_color(), label=f"{name} CVR")
    rates.set(xlabel="demonstrations learned", ylabel="rate", ylim=(-0.02, 1.02))
    rates.legend(fontsize=7)
    distances.plot(evaluation.consensus_theta, label="theta")
    distances.plot(evaluation.consensus_omega, label="omega")
    distances.set(xlabel="demonstrations learned", ylabel="consensus distance")
    distances.legend(fontsize=7)
    return figure
