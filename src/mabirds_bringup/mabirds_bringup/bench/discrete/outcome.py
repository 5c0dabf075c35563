"""One case with one seed: learn, evaluate every iteration, and keep what tables and figures show."""

from dataclasses import dataclass

import numpy as np

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.learning import drawn_streams, learn
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import policy_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Progress
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.pictures import visits
from mabirds_core.games.patrol.study import patrol_game
from mabirds_core.metrics.metrics import constraint_errors, exact_imitation, learned_constraints

DIGITS = 6
"""Decimals of costs and visits in the results; far finer than any figure shows."""


@dataclass(frozen=True)
class Outcome:
    """What one learner or central method came to; rates in [0, 1]; entry k of a list: after k updates."""

    group: str
    label: str
    learner: str
    seed: int
    violation_rate: list[float]
    success_rate: list[float]
    false_positive_rate: float
    false_negative_rate: float
    seconds: list[float]
    gradient_steps: int
    policy_solves: int
    cost_of_true: list[float]
    """Learned costs -omega of the true constraints."""
    cost_of_harmless: list[float]
    """Learned costs -omega of the other cost features."""
    learned: list[int]
    """Cost features learned as constraints."""
    visits: list[list[float]]
    """Discounted visitation of each expert's cells under the learned policy, (N_E, n)."""


def run_case(case: Case, seed: int) -> list[Outcome]:
    """One outcome a learner."""
    experiment = case.seeded(seed)
    game = patrol_game(experiment)
    history, progress = learn(case, experiment, drawn_streams(experiment, game))
    return [_outcome(case, experiment, game, name, history[name], progress[name]) for name in history]


def _outcome(
    case: Case,
    experiment: Experiment,
    game: PatrolGame,
    name: str,
    parameters: list[Parameters],
    progress: list[Progress],
) -> Outcome:
    policy, omega = policy_of(experiment, name, game), parameters[-1].omega
    imitations = [exact_imitation(game, policy(one)) for one in parameters]
    errors = constraint_errors(omega, game.true_constraints, experiment.constraint_threshold)
    return Outcome(
        case.group,
        case.label,
        name,
        experiment.seed,
        [one.violation_rate for one in imitations],
        [one.success_rate for one in imitations],
        *errors,
        [one.seconds for one in progress],
        *progress[-1].work,
        np.round(-omega[game.true_constraints], DIGITS).tolist(),
        np.round(-omega[~game.true_constraints], DIGITS).tolist(),
        np.flatnonzero(learned_constraints(omega, experiment.constraint_threshold)).tolist(),
        np.round(visits(game, policy(parameters[-1])), DIGITS).tolist(),
    )
