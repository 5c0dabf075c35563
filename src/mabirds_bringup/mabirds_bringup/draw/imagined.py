"""The ways that experts would go by what a learner believes, found in a small share of the time."""

import time

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array
from mabirds_core.experiment.assembly import evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.scene import Scene
from mabirds_core.games.whole_game import Game

SHARE = 0.1
"""Of the time that may go into finding policies: they are for people to look at."""


class Imagination:
    """What theta and omega of one learner mean.

    Parameters
    ----------
    experiment : Experiment
        That it learns.
    name : str
        Of the learner or method.
    game : Game
        Of the experiment.
    scene : Scene
        Of the game.
    """

    def __init__(self, experiment: Experiment, name: str, game: Game, scene: Scene) -> None:
        self._policy_of, self._scene, self._seed = evaluation_policy(experiment, name, game), scene, experiment.seed
        self._not_before = 0.0

    def places(self, parameters: Parameters, count: int = 1) -> Array | None:
        """Where experts would be.

        Parameters
        ----------
        parameters : Parameters
            theta and omega.
        count : int, optional
            Trajectories.

        Returns
        -------
        Array or None
            Shape (count, T + 1, N_E, 2) [m]; None where that took its share of the time already.
        """
        begun = time.monotonic()
        if begun < self._not_before:
            return None
        policy = self._policy_of(parameters)
        places = self._scene.positions(self._scene.rollouts(policy, count, np.random.default_rng(self._seed)))
        ended = time.monotonic()
        self._not_before = ended + (ended - begun) / SHARE
        return places
