"""Recording expert demonstrations to a bag: one topic per learner, the same messages from the same seed."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.whole_game import Game
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.conversion import NANOSECONDS, demonstration_message
from mabirds_msgs_py.topics import bag_topic

FIRST_STAMP = 1_700_000_000 * NANOSECONDS
"""Recording time of the first demonstration: fixed, so that a bag depends on its experiment alone."""


def record(experiment: Experiment, directory: Path, on_demonstration: Callable[[], None] = lambda: None) -> None:
    """Write a bag with ``experiment.demonstrations.per_learner`` demonstrations for each learner.

    Parameters
    ----------
    experiment : Experiment
        With game, learners and experts.
    directory : Path
        Of the bag; is made.
    on_demonstration : Callable[[], None], optional
        Called after each.

    Raises
    ------
    BagError
        The directory exists.
    InfeasibleError
        A start has no clean way to the goal.
    """
    game, settings = build_game(experiment), experiment.demonstrations
    streams = expert_streams(experiment, game)
    with BagWriter(directory) as bag:
        for iteration in range(1, settings.per_learner + 1):
            stamp = FIRST_STAMP + round((iteration - 1) * settings.period * NANOSECONDS)
            for learner, stream in streams.items():
                message = demonstration_message(game, learner, iteration, next(stream), stamp)
                bag.write(bag_topic(learner), message, stamp)
                on_demonstration()


def expert_streams(experiment: Experiment, game: Game) -> dict[str, Iterator[Trajectories]]:
    """The experts' demonstrations for each learner.

    Parameters
    ----------
    experiment : Experiment
        With learners and experts.
    game : Game
        Of the experiment.

    Returns
    -------
    dict[str, Iterator[Trajectories]]
        By learner; each stream is drawn with a generator of its own.

    Raises
    ------
    ExperimentError
        The game has no experts.
    """
    settings = experiment.demonstrations
    if not game.expert_kinds:
        raise ExperimentError(f"game {experiment.game.kind} has no experts; bring a bag of recordings instead")
    experts = game.experts(settings.experts, settings.side)
    return {
        learner: experts.demonstrations(settings.per_learner, np.random.default_rng([settings.seed, index]))
        for index, learner in enumerate(experiment.learners)
    }
