"""What theta(n) and omega(n) mean: one policy is planned and judged, by the game's judge or for another planner."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mabirds_bringup.evaluate.held_out import draw_held_out
from mabirds_bringup.evaluate.verdicts import Verdict, numbers_of, verdict
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.planners.interface import Policy


@dataclass(frozen=True)
class LearnerMetrics:
    """One learner at one iteration; rates in [0, 1], the likelihood in nats per held-out demonstration.

    Rates are None where nobody knows the truth. The certificate is in nats, too: by how much the planner's value is
    missed by what its policy earns.
    """

    learner: str
    iteration: int
    violation_rate: float | None
    success_rate: float | None
    held_out_log_likelihood: float | None
    certificate: float | None


class Task(NamedTuple):
    """What is to be judged.

    Attributes
    ----------
    learner : str
        Or method.
    iteration : int
        n.
    parameters : Parameters
        theta(n) and omega(n).
    planner : str
        A planner that took no part, whose verdict is asked for; "": none, but a row of metrics is.
    """

    learner: str
    iteration: int
    parameters: Parameters
    planner: str = ""

    @property
    def row(self) -> tuple[str, int]:
        """Of which learner and iteration."""
        return self.learner, self.iteration


class ToldConfidences(NamedTuple):
    """How sure a learner that has made all updates is of each constraint.

    Attributes
    ----------
    parameters : Parameters
        By which it is.
    confidences : Vector
        That each cost feature is a constraint, shape (K,).
    """

    parameters: Parameters
    confidences: Vector


class PolicyJudge:
    """Judges policies of an experiment, each alone and alike in any order and process.

    Parameters
    ----------
    experiment : Experiment
        What is learned.

    Attributes
    ----------
    told : Mapping[str, ToldConfidences]
        What learners have found out themselves.
    """

    def __init__(self, experiment: Experiment) -> None:
        self.experiment, self.game = experiment, build_game(experiment)
        self.held_out = draw_held_out(experiment, self.game)
        self._meanings: dict[str, Callable[[Parameters], Policy]] = {}
        self._final: dict[bytes, Policy] = {}
        self.told: Mapping[str, ToldConfidences] = {}

    def prepare(self) -> None:
        """Find out, and keep, what is known of experts before anything is learned."""
        if self.held_out.experts is not None:
            self.game.judge.distance([self.held_out.experts], self.experiment.seed)

    def policy(self, learner: str, parameters: Parameters) -> Policy:
        """What theta and omega of a learner or method mean."""
        if learner not in self._meanings:
            self._meanings[learner] = evaluation_policy(self.experiment, learner, self.game)
        return self._meanings[learner](parameters)

    def policies(self, final: Mapping[str, Parameters]) -> dict[str, Policy]:
        """What learners ended with, found once: those with the same numbers share one."""
        numbers = {name: numbers_of(self.experiment, name, parameters) for name, parameters in final.items()}
        self._final = {key: policy for key, policy in self._final.items() if key in numbers.values()}
        for name, parameters in final.items():
            if numbers[name] not in self._final:
                self._final[numbers[name]] = self.policy(name, parameters)
        return {name: self._final[numbers[name]] for name in final}

    def told_confidences(self, learner: str, parameters: Parameters) -> Vector | None:
        """What a learner has found of these parameters, if it has told."""
        told = self.told.get(learner)
        same = told is not None and all(map(np.array_equal, told.parameters, parameters))
        return told.confidences if told and same else None

    def row(self, task: Task) -> LearnerMetrics:
        """Metrics of one learner at one iteration."""
        judge, seed = self.game.judge, self.experiment.seed
        numbers = numbers_of(self.experiment, task.learner, task.parameters)
        planned = self._final[numbers] if numbers in self._final else self.policy(task.learner, task.parameters)
        violation, success = judge.imitation(planned, seed) or (None, None)
        likelihood = self.held_out.log_likelihood(self.game, planned)
        certificate = judge.certificate(planned, seed)
        return LearnerMetrics(task.learner, task.iteration, violation, success, likelihood, certificate)

    def judged(self, task: Task) -> LearnerMetrics | Verdict:
        """Whichever the task asks for."""
        if not task.planner:
            return self.row(task)
        return verdict(self.experiment, self.game, self.held_out, task.learner, task.planner, task.parameters)
