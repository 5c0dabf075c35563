"""Learners of walks: Algorithm 1 as it stands, each learner with demonstrations of its own."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mabirds_bringup.bench.pedestrians.features import WalkFeatures
from mabirds_bringup.bench.pedestrians.game import StepExpectation, StepGame, StepPlanner, StepReward
from mabirds_bringup.bench.pedestrians.situations import Walk, decisions
from mabirds_core.algorithm.adaptive_steps import AdaptiveSteps
from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.memory import WindowMemory
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, simulate_learners
from mabirds_core.games.interface import Trajectories
from mabirds_core.registry import build


@dataclass(frozen=True)
class Network:
    """Learners, and the walks that each has seen.

    Attributes
    ----------
    features : WalkFeatures
        Of steps.
    walks : Mapping[str, Sequence[Walk]]
        By learner, as many each.
    experiment : Experiment
        With the learners' schedule and way of mixing.
    """

    features: WalkFeatures
    walks: Mapping[str, Sequence[Walk]]
    experiment: Experiment

    @cached_property
    def _told(self) -> tuple[StepGame, dict[str, list[Trajectories]]]:
        """The game of all decisions, and each learner's: one demonstration is the steps of a walk."""
        every = [walk for walks in self.walks.values() for walk in walks]
        situations, chosen, whose = decisions(every, self.features.moves, self.features.headings)
        rows = iter(np.flatnonzero(whose == number) for number in range(len(every)))
        streams = {
            name: [Trajectories(row[:, None], chosen[row][:, None]) for row, _ in zip(rows, walks, strict=False)]
            for name, walks in self.walks.items()
        }
        return StepGame(self.features, situations), streams

    def learn(self, iterations: int) -> History:
        """Learn by going through the walks again and again.

        Parameters
        ----------
        iterations : int
            N.

        Returns
        -------
        History
            theta and omega of every learner.
        """
        game, streams = self._told
        reward = StepReward(game)
        estimator = GradientEstimator(game, reward, StepPlanner(game), StepExpectation(game))
        learners = {
            name: Learner(
                index=self.experiment.index_of(name),
                estimator=estimator,
                mixer=build("mabirds.mixers", self.experiment.mixing, name, self.experiment.edge_schedule),
                steps=AdaptiveSteps(),
                memory=WindowMemory(game, reward, len(streams[name]), padded=False),
                seed=self.experiment.seed,
            )
            for name in streams
        }
        repeated = {name: [stream[n % len(stream)] for n in range(iterations)] for name, stream in streams.items()}
        return simulate_learners(learners, repeated, iterations, self.experiment.closing_rounds)
