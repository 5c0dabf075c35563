"""The benchmark's pictures: the game (Figure 4a), learned costs (4b), rates and agreement against iterations."""

from collections.abc import Callable, Sequence
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.bench.cases import MABIRDS
from mabirds_bringup.bench.continuous.cases import LATTICE, SOFT_ACTOR_CRITIC, VARIATIONS
from mabirds_bringup.bench.continuous.outcome import Outcome
from mabirds_bringup.bench.figures import draw_band, save_all
from mabirds_bringup.bench.learning import drawn_streams
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.drones.pictures import LearnedCosts, costs_figure, draw_flights, draw_room
from mabirds_core.games.drones.study import drone_game

SHOWN_DEMONSTRATIONS = 40
LABEL_BOX = {"boxstyle": "round,pad=0.2", "fc": "white", "ec": "none", "alpha": 0.85}

NAMES = {LATTICE: "", SOFT_ACTOR_CRITIC: "_soft_actor_critic", VARIATIONS: "_variations"}
"""What the groups' pictures are called."""


def save_figures(main: Experiment, sac: Experiment | None, outcomes: Sequence[Outcome], directory: Path) -> list[str]:
    """Write the pictures of the groups that there are; returns their names."""
    figures = {"game.png": game_figure(main)}
    for group, suffix in NAMES.items():
        ones = [one for one in outcomes if one.group == group]
        networks = [one for one in ones if one.learner.startswith("learner")]
        learners = [one for one in networks if one.label == MABIRDS and one.seed == networks[0].seed]
        if learners:
            experiment = sac if sac and group == SOFT_ACTOR_CRITIC else main
            learned = {one.learner: LearnedCosts(np.array(one.omega), np.array(one.flights)) for one in learners}
            figures[f"cost{suffix}.png"] = costs_figure(drone_game(experiment), learned)
        if ones:
            figures[f"rates{suffix}.png"] = rates_figure(ones)
        if networks:
            figures[f"consensus{suffix}.png"] = consensus_figure(networks)
    return save_all(figures, directory)


def game_figure(experiment: Experiment) -> Figure:
    """As Figure 4a: the room and demonstrations of all drones."""
    game = drone_game(experiment)
    one_each = experiment.model_copy(update={"iterations": -(-SHOWN_DEMONSTRATIONS // len(experiment.learners))})
    streams = drawn_streams(one_each, game)
    shown = [one for stream in streams.values() for one in stream][:SHOWN_DEMONSTRATIONS]
    figure, axis = plt.subplots(figsize=(5, 5.3), layout="constrained")
    draw_room(axis, game)
    draw_flights(axis, game.positions(np.concatenate([one.states for one in shown])), range(game.n_experts))
    for drone, task in enumerate(game.settings.drones):
        for name, place in (("start", task.start), ("door", task.door.centre)):
            axis.annotate(f"{name} {drone + 1}", place, ha="center", va="center", fontsize=8, bbox=LABEL_BOX)
    axis.set_title(f"{experiment.name}: {len(shown)} demonstrations, room {_metres(game.settings.room)}", fontsize=9)
    return figure


def _metres(room: tuple[float, float]) -> str:
    return f"{room[0]:g} m x {room[1]:g} m"


def rates_figure(outcomes: Sequence[Outcome]) -> Figure:
    """SR and CVR against iterations; lines are means over seeds and learners of a case, bands their range."""
    figure, (success, violation) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
    for number, label in enumerate(dict.fromkeys(one.label for one in outcomes)):
        ones, colour = [one for one in outcomes if one.label == label], f"C{number}"
        draw_band(success, label, [one.success_rate for one in ones], color=colour)
        draw_band(violation, label, [one.violation_rate for one in ones], color=colour)
        if ones[0].actor_success_rate:
            style = {"color": colour, "linestyle": "--"}
            draw_band(success, f"{label}, actor", [one.actor_success_rate for one in ones], **style)
            draw_band(violation, f"{label}, actor", [one.actor_violation_rate for one in ones], **style)
    for axis, title in ((success, "success rate"), (violation, "constraint violation rate")):
        axis.set(xlabel="iterations made, closing rounds last", ylabel=title, ylim=(-0.02, 1.02))
        _mark_last_updates(axis, outcomes)
    figure.legend(*success.get_legend_handles_labels(), fontsize=7, loc="outside upper center", ncols=5)
    return figure


def _mark_last_updates(axis: Axes, outcomes: Sequence[Outcome]) -> None:
    for updates in {len(one.seconds) for one in outcomes}:
        axis.axvline(updates, color="0.5", linestyle=":", linewidth=0.9)


def consensus_figure(outcomes: Sequence[Outcome]) -> Figure:
    """How far the learners' parameters are from their mean; lines are means over seeds, bands their range."""
    figure, axes = plt.subplots(1, 2, figsize=(10, 3.4), layout="constrained")
    _distances(axes[0], outcomes, "theta", lambda one: one.consensus_theta)
    _distances(axes[1], outcomes, "omega", lambda one: one.consensus_omega)
    axes[0].legend(fontsize=7)
    return figure


def _distances(axis: Axes, outcomes: Sequence[Outcome], name: str, distance: Callable[[Outcome], list[float]]) -> None:
    for label in dict.fromkeys(one.label for one in outcomes):
        by_seed = {one.seed: distance(one) for one in outcomes if one.label == label}
        draw_band(axis, label, list(by_seed.values()))
    axis.set(xlabel="iterations made, closing rounds last", ylabel=f"consensus distance of {name}")
    _mark_last_updates(axis, outcomes)
