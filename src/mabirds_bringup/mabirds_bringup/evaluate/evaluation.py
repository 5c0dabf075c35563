"""From the learners' parameters to numbers: what each policy would do, and what it took for a constraint."""

from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.metrics.metrics import consensus_distance, constraint_errors, learned_constraints


@dataclass(frozen=True)
class LearnerMetrics:
    """One learner at one iteration; rates in [0, 1]."""

    learner: str
    iteration: int
    violation_rate: float
    success_rate: float
    false_positive_rate: float
    false_negative_rate: float


@dataclass(frozen=True)
class Evaluation:
    """Rows by learner and iteration, and the consensus distances by iteration."""

    rows: list[LearnerMetrics]
    consensus_theta: list[float]
    consensus_omega: list[float]
    consensus_policy: float
    learned: dict[str, list[str]]

    def final(self, learner: str) -> LearnerMetrics:
        """The newest row of a learner."""
        return [row for row in self.rows if row.learner == learner][-1]

    def of(self, learner: str) -> list[LearnerMetrics]:
        """A learner's rows in order."""
        return [row for row in self.rows if row.learner == learner]


def evaluate(experiment: Experiment, history: History, on_row: Callable[[], None] = lambda: None) -> Evaluation:
    """Judge theta(n), omega(n) of all learners by the game's judge; ``on_row`` is called after each."""
    game = build_game(experiment)
    rows = []
    for name, parameters in history.items():
        policy = evaluation_policy(experiment, name, game)
        for iteration in game.judge.eval_iterations(len(parameters)):
            current = parameters[iteration - 1]
            imitation = game.judge.imitation(policy(current), experiment.seed)
            errors = constraint_errors(current.omega, game.true_constraints, experiment.constraint_threshold)
            rows.append(LearnerMetrics(name, iteration, *imitation, *errors))
            on_row()
    together = list(zip(*history.values(), strict=False))
    final = {name: parameters[-1] for name, parameters in history.items()}
    policies = [evaluation_policy(experiment, name, game)(last) for name, last in final.items()]
    return Evaluation(
        rows,
        [consensus_distance([learner.theta for learner in learners]) for learners in together],
        [consensus_distance([learner.omega for learner in learners]) for learners in together],
        game.judge.distance(policies, experiment.seed),
        {name: _learned_names(experiment, game.cost_features.names, last) for name, last in final.items()},
    )


def _learned_names(experiment: Experiment, names: tuple[str, ...], parameters: Parameters) -> list[str]:
    learned = learned_constraints(parameters.omega, experiment.constraint_threshold)
    return [names[k] for k in np.flatnonzero(learned)]


def summary(experiment: Experiment, evaluation: Evaluation, seconds: float) -> dict[str, Any]:
    """What summary.json holds. ``seconds``: wall time of the run."""
    learners = {}
    for name in evaluation.learned:
        final = asdict(evaluation.final(name))
        learners[name] = {
            "iterations": min(final.pop("iteration") - 1, experiment.iterations),
            **{key: value for key, value in final.items() if key != "learner"},
            "learned_constraints": evaluation.learned[name],
        }
    return {
        "experiment": experiment.name,
        "constraint_threshold": experiment.constraint_threshold,
        "rates": build_game(experiment).judge.method,
        "learners": learners,
        "consensus_distance": {
            "theta": evaluation.consensus_theta[-1],
            "omega": evaluation.consensus_omega[-1],
            "policy": evaluation.consensus_policy,
        },
        "wall_seconds": seconds,
    }
