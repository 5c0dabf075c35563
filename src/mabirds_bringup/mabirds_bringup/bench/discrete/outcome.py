"""One case with one seed: learn, evaluate every iteration, and keep what tables and figures show."""

from collections.abc import Iterator

import numpy as np

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.learning import drawn_streams, learn
from mabirds_bringup.bench.results import CaseResult, MetricsRow, curve, entries
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Progress
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.study import patrol_game
from mabirds_core.games.patrol.visits import visits
from mabirds_core.metrics.constraints import by_threshold, constraint_errors
from mabirds_core.metrics.metrics import exact_imitation

DIGITS = 6
"""Decimals of costs and visits in the results; far finer than any figure shows."""


def run_case(case: Case, seed: int) -> list[CaseResult]:
    """One result per learner; rates in [0, 1].

    Of its last parameters: ``cost_of_true[k]`` and ``cost_of_harmless[k]``, learned costs -omega of true constraints
    and of the other cost features; ``learned[k]``, whether a cost feature was learned as a constraint;
    ``visits[i,c]``, discounted visitation of each expert's cells, (N_E, n).
    """
    experiment = case.seeded(seed)
    game = patrol_game(experiment)
    history, progress = learn(case, experiment, drawn_streams(experiment, game))
    return [
        CaseResult(case.group, case.label, name, seed, [*_rows(experiment, game, name, history[name], progress[name])])
        for name in history
    ]


def _rows(
    experiment: Experiment, game: PatrolGame, name: str, parameters: list[Parameters], progress: list[Progress]
) -> Iterator[MetricsRow]:
    policy, omega = evaluation_policy(experiment, name, game), parameters[-1].omega
    imitations = [exact_imitation(game, policy(known)) for known in parameters]
    yield from curve("violation_rate", [imitation.violation_rate for imitation in imitations])
    yield from curve("success_rate", [imitation.success_rate for imitation in imitations])
    yield from curve("seconds", [update.seconds for update in progress], first=1)
    yield from entries(
        len(parameters) - 1,
        **constraint_errors(by_threshold(omega, experiment.constraint_threshold), game.true_constraints)._asdict(),
        **progress[-1].work._asdict(),
        cost_of_true=np.round(-omega[game.true_constraints], DIGITS),
        cost_of_harmless=np.round(-omega[~game.true_constraints], DIGITS),
        learned=by_threshold(omega, experiment.constraint_threshold),
        visits=np.round(visits(game, policy(parameters[-1])), DIGITS),
    )
