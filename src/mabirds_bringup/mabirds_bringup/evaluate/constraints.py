"""Which cost features a learner or method takes for constraints, and how far that is true."""

from typing import NamedTuple

from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Mask, Vector
from mabirds_core.costs.models import costs_of
from mabirds_core.experiment.assembly import reward_of
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams
from mabirds_core.games.interface import ShownFeatures, shown_features
from mabirds_core.games.whole_game import Game
from mabirds_core.metrics.constraints import ConstraintErrors, by_threshold, constraint_errors, ranking_auc
from mabirds_core.rewards.shown import RewardWithShown


class Constraints(NamedTuple):
    """What a learner or method took for constraints.

    Attributes
    ----------
    learned : Mask
        Shape (K,).
    confidences : Vector or None
        Of the counterfactual test, -1 for what was demonstrated; None where the threshold decided.
    errors : ConstraintErrors or None
        Against the true ones; None where nobody knows them.
    auc : float or None
        Of the ranking by confidence, or by -omega.
    """

    learned: Mask
    confidences: Vector | None
    errors: ConstraintErrors | None
    auc: float | None


def learned_constraints(
    experiment: Experiment,
    name: str,
    parameters: Parameters,
    demonstrations: Streams,
    game: Game,
    updates: int | None = None,
    confidences: Vector | None = None,
) -> Constraints:
    """What ``name`` takes for constraints; by the threshold where there is no test, or are no demonstrations.

    ``updates``: as of ``judge_finals``. ``confidences``: of the test, where they are known.
    """
    if confidences is None:
        confidences = _tested(experiment, name, parameters, demonstrations, game, updates)
    if confidences is None:
        omega = costs_of(game).by_feature(parameters.omega)
        learned, scores = by_threshold(omega, experiment.constraint_threshold), -omega
    else:
        learned, scores = confidences >= experiment.constraint_confidence, confidences
    truth = game.true_constraints
    if truth is None:
        return Constraints(learned, confidences, None, None)
    return Constraints(learned, confidences, constraint_errors(learned, truth), ranking_auc(scores, truth))


def _tested(
    experiment: Experiment,
    name: str,
    parameters: Parameters,
    demonstrations: Streams,
    game: Game,
    updates: int | None,
) -> Vector | None:
    """Confidences of the game's test."""
    reward = reward_of(experiment, name, game)
    if isinstance(reward, RewardWithShown):
        count = len(experiment.learners) * experiment.iterations if updates is None else updates
        shown: ShownFeatures | None = reward.shown(parameters.theta, count)
    else:
        shown = _shown(experiment, name, demonstrations, game)
    if shown is None or reward is None:
        return None
    confidences: Vector | None = game.judge.constraint_confidences(reward, parameters, shown)
    return confidences


def _shown(experiment: Experiment, name: str, demonstrations: Streams, game: Game) -> ShownFeatures | None:
    """What a learner's own demonstrations showed, or all of them to a method; None where they are not here."""
    streams = [demonstrations[learner] for learner in ([name] if name in demonstrations else demonstrations)]
    learned_from = [demonstration for stream in streams for demonstration in stream[: experiment.iterations]]
    return shown_features(game, stacked(learned_from)) if learned_from else None
