"""Maps of patrols: who is where, and how the panels lie."""

import matplotlib.pyplot as plt
import numpy as np
from experiments import demonstrations, experiment

from mabirds_core.algorithm.memory import stacked
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.pictures import MAX_DEMONSTRATIONS
from mabirds_core.games.patrol.whole_game import WholePatrolGame
from mabirds_core.games.whole_game import Learned
from mabirds_core.planners.soft_bellman import soft_bellman_policy

SETTINGS = experiment({"game.map": "...\n..."})
GAME = WholePatrolGame(SETTINGS.game)


def test_a_column_is_a_learner_and_a_row_an_expert() -> None:
    constraints = np.zeros(len(GAME.cost_features.names), dtype=bool)
    constraints[[0, -1]] = True
    policy = soft_bellman_policy(GAME, GAME.task_reward)
    learned = {name: Learned(policy, np.zeros(len(constraints)), constraints) for name in ("ann", "bob", "cid")}
    figure = GAME.figure(learned, 0.1, seed=0)
    titles = [axis.get_title() for axis in figure.axes]
    assert titles == [f"{name}: expert {expert}" for expert in (1, 2) for name in learned]
    assert figure.axes[3].get_xlabel() == "joint constraints: swapping"
    (crosses,) = figure.axes[0].collections
    assert crosses.get_offsets().tolist() == [[0, 0]]
    plt.close(figure)


def test_the_first_demonstrations_are_drawn_by_expert() -> None:
    (stream, *_) = demonstrations(SETTINGS).values()
    many = stacked([stream[0]] * (MAX_DEMONSTRATIONS + 3))
    for shown in (many, Trajectories(*(steps[:2] for steps in many))):
        figure = GAME.demonstrations_figure(shown)
        assert [axis.get_title() for axis in figure.axes] == ["expert 1", "expert 2"]
        cells = GAME.cells(shown.states[0])
        for axis, of_expert in zip(figure.axes, cells, strict=True):
            assert len(axis.lines) == min(MAX_DEMONSTRATIONS, len(shown.states))
            rows = np.asarray(axis.lines[0].get_ydata()) + 0.25
            np.testing.assert_allclose(rows, of_expert // GAME.width)
        plt.close(figure)
