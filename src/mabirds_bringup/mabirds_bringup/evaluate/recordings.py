"""Judging without truth: what was learned, and what learns nothing, on demonstrations that were held out.

Intervals are of 95 %, by drawing demonstrations anew with replacement. Demonstrations that share people are not
independent; then intervals are too narrow.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mabirds_core.algorithm.memory import stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import Streams
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.recordings import Forecast, HeldOutJudge

RESAMPLES = 2000
"""Draws of the demonstrations, for intervals."""

LEARNERS = "learners, mean"
"""The row of the learners' policies together."""

SHOWN = "held-out demonstrations"
"""The row of what was shown itself."""


class Estimate(NamedTuple):
    """A mean over demonstrations with its interval of 95 %."""

    mean: float
    low: float
    high: float

    def __str__(self) -> str:
        """For tables."""
        return f"{self.mean:.3f} [{self.low:.3f}, {self.high:.3f}]"


class Row(NamedTuple):
    """What is told of one forecaster; None where there is nothing to tell.

    Attributes
    ----------
    nats : Estimate or None
        By which a step is likelier than under the uniform policy.
    average, average_best, final, final_best : Estimate or None
        Displacement [m]: mean of k trajectories, and best of them.
    conflicts : Mapping[str, float]
        Shares of trajectories.
    """

    nats: Estimate | None
    average: Estimate | None
    average_best: Estimate | None
    final: Estimate | None
    final_best: Estimate | None
    conflicts: Mapping[str, float]


class Told(NamedTuple):
    """What a forecaster is worth on each demonstration.

    Attributes
    ----------
    columns : Array
        Nats a step; average displacement, mean of k and best; final displacement, the same; shape (5, m).
    conflicts : Mapping[str, float]
        Shares of its trajectories.
    """

    columns: Array
    conflicts: Mapping[str, float]


def judged_by_recordings(
    experiment: Experiment,
    final: Mapping[str, Parameters],
    training: Streams,
    held_out: Trajectories,
    count: int,
    on_row: Callable[[str], None] = lambda _: None,
) -> dict[str, Row]:
    """Rows of learners, of their mean, of baselines, and of what was shown.

    Parameters
    ----------
    experiment : Experiment
        What was learned.
    final : Mapping[str, Parameters]
        theta and omega of each learner or method.
    training : Streams
        Demonstrations that learners had.
    held_out : Trajectories
        Demonstrations that nobody had.
    count : int
        k: trajectories from each start.
    on_row : Callable[[str], None], optional
        Called with the name of each row that is done.

    Returns
    -------
    dict[str, Row]
        By name.

    Raises
    ------
    ExperimentError
        The game, or its planner, has no likelihoods to compare.
    """
    game = build_game(experiment)
    judge: HeldOutJudge | None = getattr(game, "held_out_judge", None)
    policies = {name: evaluation_policy(experiment, name, game)(parameters) for name, parameters in final.items()}
    first = next(iter(policies.values()))
    if judge is None or game.judge.log_likelihoods(first, held_out) is None:
        raise ExperimentError(f"game {experiment.game.kind}: with this planner it cannot be judged by recordings")
    shown = stacked([demonstration for stream in training.values() for demonstration in stream])
    told = dict[str, Told]()
    forecasts = {name: judge.of_policy(policy) for name, policy in policies.items()}
    forecasts |= judge.baselines(first, experiment.algorithm.policy, shown)
    for name, forecast in forecasts.items():
        told[name] = _told(judge, forecast, held_out, count, experiment.seed)
        on_row(name)
    rows = {name: _row(values, experiment.seed) for name, values in told.items()}
    together = _row(_mean([told[name] for name in policies]), experiment.seed)
    shown_row = Row(None, None, None, None, None, judge.conflicts(held_out))
    return {LEARNERS: together, **rows, SHOWN: shown_row}


def _told(judge: HeldOutJudge, forecast: Forecast, held_out: Trajectories, count: int, seed: int) -> Told:
    nats = forecast.log_ratios(held_out) / np.maximum(1.0, judge.steps(held_out))
    flown = forecast.rollouts(held_out, count, np.random.default_rng([seed, count]))
    away = judge.displacements(held_out, flown, count)
    of_k = [values for of in away for values in (of.mean(axis=1), of.min(axis=1))]
    return Told(np.stack([nats, *of_k]), judge.conflicts(flown))


def _mean(told: Sequence[Told]) -> Told:
    """Over learners, demonstration by demonstration; the best of k is that of each learner's own k."""
    conflicts = {name: float(np.mean([of.conflicts[name] for of in told])) for name in told[0].conflicts}
    return Told(np.mean([of.columns for of in told], axis=0), conflicts)


def _row(told: Told, seed: int) -> Row:
    nats, average, average_best, final, final_best = (estimate(column, seed) for column in told.columns)
    return Row(nats, average, average_best, final, final_best, told.conflicts)


def estimate(values: Vector, seed: int) -> Estimate:
    """The mean of values with its interval.

    Parameters
    ----------
    values : Vector
        One per demonstration.
    seed : int
        Of the draws.

    Returns
    -------
    Estimate
        Percentiles 2.5 and 97.5 of the means of RESAMPLES draws.
    """
    drawn = np.random.default_rng(seed).integers(len(values), size=(RESAMPLES, len(values)))
    low, high = np.quantile(values[drawn].mean(axis=1), (0.025, 0.975))
    return Estimate(float(values.mean()), float(low), float(high))
