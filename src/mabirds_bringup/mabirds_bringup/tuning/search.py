"""Cross-validation by demonstrations: what each trial's settings, stopped early, make of demonstrations left out.

Every learner's demonstrations are cut into blocks in their order. Each block judges once, by the likelihood under what
was learned from the others. Where a bag shows demonstrations several times, all copies are on one side.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from mabirds_bringup.tuning.choices import Changes, changed
from mabirds_core.algorithm.memory import stacked
from mabirds_core.arrays import Indices, Vector
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams, simulate
from mabirds_core.games.interface import Trajectories

STOPS = 6
"""Numbers of iterations that are judged, evenly spread."""


class Fold(NamedTuple):
    """A part of the cross-validation.

    Attributes
    ----------
    learning : Streams
        Of each learner.
    judging : Trajectories
        Left out by all.
    """

    learning: Streams
    judging: Trajectories


class Trial(NamedTuple):
    """What came of some settings.

    Attributes
    ----------
    changes : Changes
        Of the experiment file.
    stops : Indices
        Numbers of iterations that were judged.
    scores : Vector
        Nats of a demonstration left out, mean over learners and folds, at each of them.
    """

    changes: Changes
    stops: Indices
    scores: Vector

    @property
    def score(self) -> float:
        """Of the best number of iterations."""
        return float(self.scores.max())

    @property
    def iterations(self) -> int:
        """The first of the best."""
        return int(self.stops[self.scores.argmax()])

    @property
    def stops_early(self) -> bool:
        """Are fewer iterations better than all?"""
        return self.iterations < int(self.stops[-1])


def folds_of(streams: Streams, count: int) -> Iterator[Fold]:
    """Cut demonstrations into blocks.

    Parameters
    ----------
    streams : Streams
        Of each learner.
    count : int
        How many blocks.

    Yields
    ------
    Fold
        As many as blocks.

    Raises
    ------
    ExperimentError
        A learner has fewer different demonstrations than blocks.
    """
    blocks = {name: _blocks(name, stream, count) for name, stream in streams.items()}
    for fold in range(count):
        learning = {
            name: [one for one, block in zip(stream, blocks[name], strict=True) if block != fold]
            for name, stream in streams.items()
        }
        judging = {
            _content(one): one
            for name, stream in streams.items()
            for one, block in zip(stream, blocks[name], strict=True)
            if block == fold
        }
        yield Fold(learning, stacked([*judging.values()]))


def _content(demonstration: Trajectories) -> bytes:
    return b"".join(np.ascontiguousarray(part).tobytes() for part in demonstration)


def _blocks(name: str, stream: Sequence[Trajectories], count: int) -> Indices:
    """The block of each demonstration; copies are in one."""
    keys = [_content(one) for one in stream]
    numbers = {key: number for number, key in enumerate(dict.fromkeys(keys))}
    if len(numbers) < count:
        raise ExperimentError(
            f"{name} has {len(numbers)} different demonstrations, expected at least {count}; take fewer folds"
        )
    return np.array([numbers[key] * count // len(numbers) for key in keys])


def tried_out(
    experiment: Experiment, changes: Changes, folds: Sequence[Fold], on_fold: Callable[[], None] = lambda: None
) -> Trial:
    """Learn with changed settings from the blocks of each fold, and judge by what it left out.

    Parameters
    ----------
    experiment : Experiment
        As in its file.
    changes : Changes
        Of its settings.
    folds : Sequence[Fold]
        Of its demonstrations.
    on_fold : Callable, optional
        Is called after each of them.

    Returns
    -------
    Trial
        With scores.
    """
    least = min(len(stream) for fold in folds for stream in fold.learning.values())
    shorter = changed(experiment, changes).model_copy(update={"iterations": min(least, experiment.iterations)})
    stops = np.unique(np.linspace(0, shorter.iterations, STOPS + 1).round().astype(np.int64))[1:]
    scores = list[Vector]()
    for fold in folds:
        scores.append(_scores(shorter, fold, stops))
        on_fold()
    return Trial(changes, stops, np.mean(scores, axis=0))


def _scores(experiment: Experiment, fold: Fold, stops: Indices) -> Vector:
    game, history = build_game(experiment), simulate(experiment, fold.learning)
    found = list[list[float]]()
    for name, parameters in history.items():
        policy_of = evaluation_policy(experiment, name, game)
        found.append([_nats(game, policy_of(parameters[stop]), fold.judging) for stop in stops])
    return np.mean(found, axis=0)


def _nats(game: Any, policy: Any, judging: Trajectories) -> float:
    nats = game.judge.log_likelihoods(policy, judging)
    if nats is None:
        raise ExperimentError("algorithm.policy: this planner tells no likelihood of demonstrations; take another one")
    return float(nats.mean())


def settings_of(trial: Trial, experiment: Experiment) -> Mapping[str, Any]:
    """What the tuned file changes: the trial's settings, and fewer iterations where that is better."""
    return {**trial.changes, "iterations": trial.iterations if trial.stops_early else experiment.iterations}
