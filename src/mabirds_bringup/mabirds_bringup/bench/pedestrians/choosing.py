"""Settings by cross-validation on training pairs alone: how far walkers look ahead, and when to stop.

The time of the training is cut into blocks. Of each in turn the pairs that begin in it judge, and learners see those
of the other blocks that share nobody with them.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mabirds_bringup.bench.pedestrians.data import Pair
from mabirds_bringup.bench.pedestrians.features import WalkFeatures
from mabirds_bringup.bench.pedestrians.game import StepPolicy
from mabirds_bringup.bench.pedestrians.learning import Network
from mabirds_bringup.bench.pedestrians.situations import decisions
from mabirds_core.arrays import Vector
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History

LOOKAHEADS = (1, 5)
"""Steps that are tried."""

EVERY = 20
"""Iterations between two judgements."""

LEAST = 0.002
"""Nats a step by which more iterations must be better."""


class Choice(NamedTuple):
    """What was chosen, and why.

    Attributes
    ----------
    lookahead : int
        Steps.
    iterations : int
        N.
    most : int
        Iterations that were tried.
    curves : Mapping[int, Vector]
        By lookahead: nats a step at every EVERY iterations, mean over blocks and learners.
    """

    lookahead: int
    iterations: int
    most: int
    curves: Mapping[int, Vector]


Split = tuple[list[Pair], list[Pair]]
"""Pairs that are learned from, and pairs that judge."""


def splits(pairs: Sequence[Pair], folds: int) -> Iterator[Split]:
    """Cut pairs into blocks of time.

    Parameters
    ----------
    pairs : Sequence[Pair]
        Of the training.
    folds : int
        How many blocks.

    Yields
    ------
    Split
        No person is on both sides.
    """
    begins = np.array([pair.begin for pair in pairs])
    borders = np.quantile(begins, np.linspace(0.0, 1.0, folds + 1))[1:-1]
    block = np.searchsorted(borders, begins, side="right")
    for fold in range(folds):
        judging = [pair for pair, of in zip(pairs, block, strict=True) if of == fold]
        known = {person for pair in judging for person in pair.people}
        learning = [pair for pair, of in zip(pairs, block, strict=True) if of != fold and not known & {*pair.people}]
        yield learning, judging


def shared(pairs: Sequence[Pair], experiment: Experiment) -> dict[str, list[Pair]]:
    """Pairs by learner, as many each, in turn."""
    count = len(experiment.learners)
    each = len(pairs) // count
    return {name: list(pairs[k : each * count : count]) for k, name in enumerate(experiment.learners)}


def chosen_settings(
    pairs: Sequence[Pair],
    features: WalkFeatures,
    experiment: Experiment,
    iterations: int,
    folds: int,
    on_run: Callable[[], None] = lambda: None,
) -> Choice:
    """Choose on training pairs.

    Parameters
    ----------
    pairs : Sequence[Pair]
        Of the training.
    features : WalkFeatures
        Whose lookahead is chosen.
    experiment : Experiment
        With learners.
    iterations : int
        N, at most.
    folds : int
        Blocks.
    on_run : Callable, optional
        Is called after each of len(LOOKAHEADS) times ``folds`` runs.

    Returns
    -------
    Choice
        The best lookahead, and the first number of iterations that is within LEAST of its best.
    """
    curves = dict[int, Vector]()
    for lookahead in LOOKAHEADS:
        looking = replace(features, lookahead=lookahead)
        found = list[Vector]()
        for learning, judging in splits(pairs, folds):
            walks = {name: [of.walk for of in mine] for name, mine in shared(learning, experiment).items()}
            history = Network(looking, walks, experiment).learn(iterations)
            found.append(curve(history, looking, judging, iterations))
            on_run()
        curves[lookahead] = np.mean(found, axis=0)
    best = max(curves, key=lambda of: float(curves[of].max()))
    first = int((curves[best] >= curves[best].max() - LEAST).argmax())
    return Choice(best, int(judged_at(iterations)[first]), iterations, curves)


def judged_at(iterations: int) -> Vector:
    """Every EVERY iterations, and the last one."""
    return np.unique([*range(EVERY, iterations + 1, EVERY), iterations])


def curve(history: History, features: WalkFeatures, judging: Sequence[Pair], iterations: int) -> Vector:
    """Nats a step against uniform moves at ``judged_at``, mean over learners."""
    situations, chosen, _ = decisions([of.walk for of in judging], features.moves, features.headings)
    tables, rows = features.tables(situations), np.arange(len(chosen))
    return np.array(
        [
            np.mean(
                [
                    (StepPolicy(features, *of[n]).of_tables(tables) - features.moves.log_shares)[rows, chosen].mean()
                    for of in history.values()
                ]
            )
            for n in judged_at(iterations)
        ]
    )
