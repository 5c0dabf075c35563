"""Held-out pairs: nats and displacements of all forecasts, with intervals for people who are in several pairs.

Intervals are of 95 %, by the pigeonhole bootstrap (Owen, 2007): those who walk north and those who walk south are drawn
anew, each for themselves, and a pair counts as often as its two people together. Drawing pairs alone would take pairs
that share a person for independent ones.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from mabirds_bringup.bench.pedestrians.data import Pair
from mabirds_bringup.bench.pedestrians.forecasts import Forecast, Training, nats
from mabirds_bringup.bench.pedestrians.situations import decisions
from mabirds_bringup.bench.pedestrians.walking import Draws, Scene, displacements, drawn_by
from mabirds_bringup.evaluate.recordings import Estimate
from mabirds_core.arrays import Array, Vector

RESAMPLES = 4000

MEASURES = ("nats", "average", "average_best", "final", "final_best")
"""Nats a step against uniform moves; displacements [m], mean of k ways and best of them."""


class Judged(NamedTuple):
    """Values of each measure for each held-out pair, by forecast.

    Attributes
    ----------
    by_name : Mapping[str, Array]
        Shape (len(MEASURES), m).
    weights : Array
        How often each pair counts in each resample, shape (RESAMPLES, m).
    """

    by_name: Mapping[str, Array]
    weights: Array

    def estimate(self, name: str, measure: str, less: str | None = None) -> Estimate:
        """The mean of a forecast, or by how much it is above that of another one."""
        row = MEASURES.index(measure)
        values = self.by_name[name][row] - (0.0 if less is None else self.by_name[less][row])
        return weighted_estimate(values, self.weights)


def pigeonhole_weights(pairs: Sequence[Pair], seed: int) -> Array:
    """How often pairs count in resamples of their people.

    Parameters
    ----------
    pairs : Sequence[Pair]
        m of them.
    seed : int
        Of the draws.

    Returns
    -------
    Array
        Shape (RESAMPLES, m); resamples without any pair are drawn again.
    """
    rng, total = np.random.default_rng(seed), np.empty((0, len(pairs)))
    sides = [np.unique([pair.people[k] for pair in pairs], return_inverse=True) for k in (0, 1)]
    while len(total) < RESAMPLES:
        counts = [rng.multinomial(len(who), np.full(len(who), 1 / len(who)), RESAMPLES)[:, of] for who, of in sides]
        drawn = counts[0] * counts[1]
        total = np.concatenate([total, drawn[drawn.sum(axis=1) > 0]])
    return np.asarray(total[:RESAMPLES])


def weighted_estimate(values: Vector, weights: Array) -> Estimate:
    """The mean of values (m,), and percentiles 2.5 and 97.5 of its resamples."""
    means = weights @ values / weights.sum(axis=1)
    low, high = np.quantile(means, (0.025, 0.975))
    return Estimate(float(values.mean()), float(low), float(high))


def judged(
    forecasts: Mapping[str, Forecast],
    whole_ways: Mapping[str, Draws],
    pairs: Sequence[Pair],
    scene: Scene,
    count: int,
    seed: int,
    on_forecast: Callable[[], None] = lambda: None,
) -> dict[str, Array]:
    """Judge forecasts.

    Parameters
    ----------
    forecasts : Mapping[str, Forecast]
        By name.
    whole_ways : Mapping[str, Draws]
        Of those that do not draw step by step.
    pairs : Sequence[Pair]
        m held-out ones.
    scene : Scene
        Where they walk.
    count : int
        k: ways from each start.
    seed : int
        Of the draws.
    on_forecast : Callable, optional
        Is called after each of them.

    Returns
    -------
    dict[str, Array]
        Shape (len(MEASURES), m) each, by name.
    """
    walks, found = [pair.walk for pair in pairs], dict[str, Array]()
    situations, chosen, whose = decisions(walks, scene.moves, scene.headings)
    told, steps = Training(situations, chosen), np.bincount(whose, minlength=len(walks))
    for name, forecast in forecasts.items():
        a_step = np.bincount(whose, nats(forecast, scene.moves, told), minlength=len(walks)) / steps
        draws = whole_ways.get(name) or drawn_by(forecast, scene)
        away = displacements(draws, walks, count, np.random.default_rng([seed, count]))
        of_k = [values for of in away for values in (of.mean(axis=1), of.min(axis=1))]
        found[name] = np.stack([a_step, *of_k])
        on_forecast()
    return found
