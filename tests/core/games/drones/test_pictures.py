"""Pictures of drones: what is where, and an ordinary run's."""

from collections.abc import Callable
from itertools import islice
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pytest

mpl.use("Agg")
import matplotlib.pyplot as plt
from arenas import drone_game
from matplotlib.axes import Axes
from matplotlib.patches import Circle, Rectangle

from mabirds_bringup.evaluate.evaluation import Evaluation, evaluate
from mabirds_bringup.report.figures import learned_by, save_figures
from mabirds_core.algorithm.memory import stacked
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History, simulate
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.learned_costs import place_costs
from mabirds_core.games.drones.pictures import (
    RESOLUTION,
    SHOWN_DEMONSTRATIONS,
    LearnedCosts,
    alike,
    colour_of,
    cost_field,
    draw_arena,
    draw_costs,
    draw_distance_costs,
    draw_trajectories,
    way_cost,
)
from mabirds_core.games.interface import Trajectories
from mabirds_expert_player.recorder import expert_streams

MakeExperiment = Callable[..., Path]


@pytest.fixture(scope="module")
def drones(make_shared_drone_experiment: MakeExperiment) -> Experiment:
    return load_experiment(make_shared_drone_experiment(iterations=2))


@pytest.fixture
def game(drones: Experiment) -> DroneGame:
    return drone_game(drones)


@pytest.fixture
def axis() -> Axes:
    figure, axis = plt.subplots()
    yield axis
    plt.close(figure)


def circles(axis: Axes) -> set[tuple[float, float, float]]:
    return {
        (round(one.center[0], 9), round(one.center[1], 9), round(one.radius, 9))
        for one in axis.patches
        if isinstance(one, Circle)
    }


def test_an_arena_shows_obstacles_what_they_keep_off_goal_regions_and_starts(game: DroneGame, axis: Axes) -> None:
    draw_arena(axis, game)
    assert circles(axis) == {(1.5, 1.5, 0.3), (1.5, 1.5, 0.42), (2.6, 2.6, 0.3), (0.4, 2.6, 0.3)}
    squares = [one for one in axis.patches if isinstance(one, Rectangle)]
    assert [one.get_xy() for one in squares] == [pytest.approx((0.3, 0.3)), pytest.approx((2.5, 0.3))]
    assert (axis.get_xlim(), axis.get_ylim()) == ((0, 3), (0, 3))


def test_an_arena_of_one_drone_leaves_the_others_out(game: DroneGame, axis: Axes) -> None:
    draw_arena(axis, game, [1])
    assert circles(axis) == {(1.5, 1.5, 0.3), (1.5, 1.5, 0.42), (0.4, 2.6, 0.3)}


def test_rollouts_are_lines_in_the_drones_colours(axis: Axes) -> None:
    places = np.random.default_rng(0).random((3, 5, 2, 2))
    draw_trajectories(axis, places, [1])
    assert [line.get_color() for line in axis.lines] == [colour_of(1)] * 3
    np.testing.assert_array_equal(np.column_stack(axis.lines[2].get_data()), places[2, :, 1])


def test_a_field_is_drawn_where_it_is(game: DroneGame) -> None:
    nodes = game.cost_features.grid.nodes
    omega = np.zeros(len(game.cost_features.names))
    chosen = int(np.flatnonzero((nodes[:, 0] > 2) & (nodes[:, 1] < 1))[0])  # right, below
    omega[len(nodes) + chosen] = -5.0
    field = cost_field(game, omega, 1)
    row, column = np.unravel_index(field.argmax(), field.shape)
    np.testing.assert_allclose((np.array([column, row]) + 0.5) * RESOLUTION, nodes[chosen], atol=RESOLUTION)
    assert field.max() == pytest.approx(5.0, rel=0.05)
    assert not cost_field(game, omega, 0).any()


def test_costs_have_a_panel_a_learner_and_drone_and_one_scale(game: DroneGame) -> None:
    rng, figure = np.random.default_rng(0), plt.figure()
    omegas = rng.normal(size=(3, len(game.cost_features.names)))
    learned = {f"l{k}": LearnedCosts(omega, rng.random((4, 5, 2, 2))) for k, omega in enumerate(omegas)}
    draw_costs(figure, game, learned)
    panels = [axis for axis in figure.axes if axis.images]
    assert [axis.get_title() for axis in panels] == [f"l{k}, drone {i}" for i in (1, 2) for k in range(3)]
    assert len({axis.images[0].get_clim() for axis in panels}) == 1
    low, high = panels[0].images[0].get_clim()
    assert low == min(axis.images[0].get_array().min() for axis in panels)
    assert high == max(axis.images[0].get_array().max() for axis in panels)
    assert all(len(axis.lines) == 4 for axis in panels)
    zero = place_costs(game, omegas[2], 1, learned["l2"].places[:, :, 1]).mean()
    np.testing.assert_allclose(panels[-1].images[0].get_array(), cost_field(game, omegas[2], 1) - zero)
    first, other_goal = circles(panels[0]), (0.4, 2.6, 0.3)
    assert (2.6, 2.6, 0.3) in first
    assert other_goal not in first
    plt.close(figure)


def test_ways_end_where_a_drone_arrives(game: DroneGame) -> None:
    """What it costs to stay in the goal region says nothing of the way there."""
    omega = np.random.default_rng(0).normal(size=len(game.cost_features.names))
    flight = np.array(
        [[[0.5, 0.5], [2.5, 0.5]], [[1.0, 1.5], [1.5, 2.2]], [[2.6, 2.6], [0.4, 2.6]], [[2.6, 2.6], [0.4, 2.6]]]
    )
    expected = place_costs(game, omega, 1, flight[:2, 1]).mean()
    assert way_cost(game, omega, 1, flight[None]) == pytest.approx(expected)
    assert way_cost(game, omega, 1, flight[None, 2:]) == 0.0


def test_learners_that_agree_are_drawn_once() -> None:
    same, other, places = np.ones(3), np.zeros(3), np.zeros((1, 1, 2, 2))
    learned = {name: LearnedCosts(omega, places) for name, omega in (("a", same), ("b", other), ("c", same.copy()))}
    assert list(alike(learned)) == ["a + 1 alike", "b"]


def test_costs_of_distances_are_all_on_one_axis(game: DroneGame, axis: Axes) -> None:
    omega = np.zeros(len(game.cost_features.names))
    omega[-4] = -1.0
    draw_distance_costs(axis, game, {"a": omega, "b": 2 * omega})
    first, second, least = axis.lines
    np.testing.assert_allclose(second.get_ydata(), 2 * first.get_ydata())
    assert first.get_ydata()[0] > first.get_ydata()[-1]
    assert least.get_xdata()[0] == game.settings.least_distance


@pytest.fixture(scope="module")
def streams(drones: Experiment) -> dict[str, list[Trajectories]]:
    return {name: list(islice(stream, 2)) for name, stream in expert_streams(drones, drone_game(drones)).items()}


@pytest.fixture(scope="module")
def history(drones: Experiment, streams: dict[str, list[Trajectories]]) -> History:
    return simulate(drones, streams)


@pytest.fixture(scope="module")
def evaluation(drones: Experiment, history: History, streams: dict[str, list[Trajectories]]) -> Evaluation:
    return evaluate(drones, history, streams)


def test_a_run_of_drones_has_its_pictures(
    drones: Experiment, history: History, evaluation: Evaluation, tmp_path: Path
) -> None:
    pictures = save_figures(drones, drone_game(drones), history, evaluation, tmp_path)
    assert list(pictures) == ["map.png", "curves.png", "schedule.png"]
    assert all((tmp_path / name).read_bytes().startswith(b"\x89PNG") for name in pictures)


def test_the_map_of_a_run_of_drones_shows_every_learner(
    drones: Experiment, history: History, evaluation: Evaluation
) -> None:
    figure = drone_game(drones).figure(learned_by(history, evaluation), 0.1, seed=0)
    assert sum(bool(axis.images) for axis in figure.axes) == 2 * len(history)
    assert len({at[-1].omega.tobytes() for at in history.values()}) == len(history)
    plt.close(figure)


def test_demonstrations_are_drawn_in_their_arena(drones: Experiment, streams: dict[str, list[Trajectories]]) -> None:
    many = stacked([demonstration for stream in streams.values() for demonstration in stream] * SHOWN_DEMONSTRATIONS)
    figure = drone_game(drones).demonstrations_figure(many)
    (axis,) = figure.axes
    assert len(axis.lines) == 2 * SHOWN_DEMONSTRATIONS
    assert [text.get_text() for text in axis.texts] == ["start 1", "goal 1", "start 2", "goal 2"]
    assert axis.get_title() == "40 demonstrations, arena 3 m x 3 m"
    plt.close(figure)
