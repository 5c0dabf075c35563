"""Pictures of a run: what the learned policies do, what counts as forbidden or costs, how learning went."""

from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from mabirds_bringup.evaluate.evaluation import Evaluation, flights_of, visits
from mabirds_core.experiment.assembly import drone_game, patrol_game, policy_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.rooms import Learned, draw_costs, draw_distance_costs
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.patrol.maps import draw_map
from mabirds_core.metrics.metrics import learned_constraints

DOTS_PER_INCH = 110
SHOWN_FLIGHTS = 15


def save_figures(experiment: Experiment, history: History, evaluation: Evaluation, directory: Path) -> list[str]:
    """Write map.png and curves.png; returns their names."""
    of_game = rooms_figure if isinstance(experiment.game, DroneSettings) else map_figure
    figures = {"map.png": of_game(experiment, history), "curves.png": curves_figure(evaluation)}
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
    return list(figures)


def map_figure(experiment: Experiment, history: History) -> Figure:
    """A panel a learner and expert: visitation in blue, learned constraints as red crosses, obstacles in grey."""
    game, names = patrol_game(experiment), list(history)
    size = (2.6 * game.n_experts + 0.8, 2.8 * len(names))
    figure, axes = plt.subplots(len(names), game.n_experts, figsize=size, squeeze=False, layout="constrained")
    for name, row in zip(names, axes, strict=True):
        visited = visits(game, policy_of(experiment, name, game)(history[name][-1]))
        learned = learned_constraints(history[name][-1].omega, experiment.constraint_threshold)
        for expert, axis in enumerate(row):
            cells = slice(expert * game.n_cells, (expert + 1) * game.n_cells)
            draw_map(axis, game, expert, visited[expert], learned[cells])
            axis.set_title(f"{name}: expert {expert + 1}", fontsize=9)
        row[0].set_ylabel(_joint_constraints(learned), fontsize=7)
    figure.suptitle("learned policy (blue), learned constraints (red), true obstacles (grey)", fontsize=10)
    return figure


def _joint_constraints(learned: np.ndarray) -> str:
    found = [name for name, is_learned in zip(("sharing", "swapping"), learned[-2:], strict=True) if is_learned]
    return "joint constraints: " + (", ".join(found) or "none")


def rooms_figure(experiment: Experiment, history: History) -> Figure:
    """A panel a learner and drone: what places cost and some flights; what distances cost."""
    game, learned = drone_game(experiment), dict[str, Learned]()
    for name, parameters in history.items():
        flights = flights_of(experiment, game, policy_of(experiment, name, game)(parameters[-1]), SHOWN_FLIGHTS)
        learned[name] = Learned(parameters[-1].omega, game.positions(flights.states))
    return costs_figure(game, learned)


def costs_figure(game: DroneGame, learned: dict[str, Learned]) -> Figure:
    """Learned costs by learner: of each drone's places, with flights, and of the drones' distances."""
    width = 2.3 * len(learned) + 1.0
    figure = plt.figure(figsize=(width + 3.6, 2.3 * game.n_experts + 0.5), layout="constrained")
    rooms, distances = figure.subfigures(1, 2, squeeze=False, width_ratios=(width, 3.6))[0]
    draw_costs(rooms, game, learned)
    draw_distance_costs(distances.subplots(), game, {name: one.omega for name, one in learned.items()})
    return figure


def curves_figure(evaluation: Evaluation) -> Figure:
    """Success and violation rates, and the consensus distances, against iterations."""
    figure, (rates, distances) = plt.subplots(1, 2, figsize=(9, 3.2), layout="constrained")
    for name in evaluation.learned:
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
