"""The benchmark's pictures: the game (Figure 4a), learned costs (4b), rates and agreement against iterations."""

from itertools import chain, islice
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import polars as pl
from matplotlib.figure import Figure

from mabirds_bringup.bench.cases import MABIRDS
from mabirds_bringup.bench.continuous.cases import LATTICE, SOFT_ACTOR_CRITIC, VARIATIONS
from mabirds_bringup.bench.figures import ITERATIONS, draw_band, mark_last_updates, rates_figure, save_all
from mabirds_bringup.bench.frame import array_of, in_order
from mabirds_bringup.bench.learning import drawn_streams
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.drones.pictures import LearnedCosts, costs_figure, draw_arena, draw_trajectories
from mabirds_core.games.drones.study import drone_game

SHOWN_DEMONSTRATIONS = 40
LABEL_BOX = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85}
LEGEND = {"loc": "outside upper center", "ncols": 5}

NAMES = {LATTICE: "", SOFT_ACTOR_CRITIC: "_soft_actor_critic", VARIATIONS: "_variations"}
"""What the groups' pictures are called."""


def save_figures(main: Experiment, sac: Experiment | None, results: pl.DataFrame, directory: Path) -> list[str]:
    """Write the pictures of the groups that there are; returns their names."""
    figures = {"game.png": game_figure(main)}
    for group, suffix in NAMES.items():
        own = results.filter(group=group)
        networks = own.filter(pl.col("learner").str.starts_with("learner"))
        first = networks.filter(pl.col("seed") == pl.col("seed").first()).filter(label=MABIRDS)
        if len(first):
            experiment = sac if sac and group == SOFT_ACTOR_CRITIC else main
            figures[f"cost{suffix}.png"] = costs_figure(drone_game(experiment), learned_of(first))
        if len(own):
            rates = rates_figure(own, "label", LEGEND, height=3.8)
            figures[f"rates{suffix}.png"] = mark_last_updates(rates, own)
        if len(networks):
            figures[f"consensus{suffix}.png"] = mark_last_updates(consensus_figure(networks), networks)
    return save_all(figures, directory)


def learned_of(results: pl.DataFrame) -> dict[str, LearnedCosts]:
    """What the learners of one case with one seed took for costs, and some of their flights."""
    by_learner = {learner: results.filter(learner=learner) for learner in in_order(results, "learner")}
    return {name: LearnedCosts(array_of(own, "omega"), array_of(own, "flights")) for name, own in by_learner.items()}


def game_figure(experiment: Experiment) -> Figure:
    """As Figure 4a: the room and demonstrations of all drones."""
    game = drone_game(experiment)
    few = experiment.model_copy(update={"iterations": -(-SHOWN_DEMONSTRATIONS // len(experiment.learners))})
    streams = drawn_streams(few, game)
    shown = list(islice(chain.from_iterable(streams.values()), SHOWN_DEMONSTRATIONS))
    figure, axis = plt.subplots(figsize=(5, 5.3), layout="constrained")
    draw_arena(axis, game)
    draw_trajectories(axis, game.positions(np.concatenate([flight.states for flight in shown])), range(game.n_experts))
    for drone, task in enumerate(game.settings.drones):
        for name, place in (("start", task.start), ("door", task.goal_region.centre)):
            axis.annotate(f"{name} {drone + 1}", place, ha="center", va="center", fontsize=8, bbox=LABEL_BOX)
    axis.set_title(f"{experiment.name}: {len(shown)} demonstrations, room {_metres(game.settings.arena)}", fontsize=9)
    return figure


def _metres(room: tuple[float, float]) -> str:
    return f"{room[0]:g} m x {room[1]:g} m"


def consensus_figure(results: pl.DataFrame) -> Figure:
    """How far the learners' parameters are from their mean; lines are means over seeds, bands their range."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
    for axis, parameter in zip(axes, ("theta", "omega"), strict=True):
        for label in in_order(results, "label"):
            draw_band(axis, results.filter(label=label), f"consensus_{parameter}", label)
        axis.set(xlabel=ITERATIONS, ylabel=f"consensus distance of {parameter}")
    axes[0].legend(fontsize=7)
    return figure
