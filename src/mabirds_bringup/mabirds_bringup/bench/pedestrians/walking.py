"""Whole ways from where walks began: what a forecast draws step by step, and how far it is from what was shown.

The first step is told to all. Experts who left the area meet nobody any more.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from mabirds_bringup.bench.pedestrians.forecasts import Forecast
from mabirds_bringup.bench.pedestrians.moves import Moves
from mabirds_bringup.bench.pedestrians.situations import Walk, seen_from
from mabirds_core.arrays import Array, Mask, Vector


class Scene(NamedTuple):
    """Where walks take place.

    Attributes
    ----------
    moves : Moves
        Of walkers.
    headings : Array
        Where each role goes, unit vectors, shape (2, 2).
    low, high : Array
        Corners of the area, shape (2,) [m].
    """

    moves: Moves
    headings: Array
    low: Array
    high: Array

    def inside(self, places: Array) -> Mask:
        """Which places (..., 2) are in the area, shape (...)."""
        return np.asarray(((places >= self.low) & (places <= self.high)).all(axis=-1))


class Away(NamedTuple):
    """Distances of ways drawn to walks that were shown.

    Attributes
    ----------
    average, final : Array
        Mean over experts and steps, and over experts at their last step, shape (m, k) [m].
    """

    average: Array
    final: Array


Draws = Callable[[Walk, int, np.random.Generator], Array]
"""k ways from where a walk began, shape (k, L + 1, 2, 2)."""


def drawn_by(forecast: Forecast, scene: Scene) -> Draws:
    """Ways that a forecast draws step by step."""

    def draw(walk: Walk, count: int, rng: np.random.Generator) -> Array:
        places = np.empty((count, *walk.places.shape))
        places[:, :2] = walk.places[:2]
        for step in range(1, len(walk.places) - 1):
            places[:, step + 1] = places[:, step] + _next_ways(forecast, scene, places[:, step - 1 : step + 1], rng)
        return places

    return draw


def _next_ways(forecast: Forecast, scene: Scene, places: Array, rng: np.random.Generator) -> Array:
    """Of both experts, from their places at two steps (k, 2, 2, 2), shape (k, 2, 2)."""
    here, before = places[:, 1], places[:, 1] - places[:, 0]
    ways = np.empty_like(here)
    for role in range(2):
        situations = seen_from(role, here, before, scene.inside(here), scene.headings)
        chances = forecast.log_chances(situations)
        cells = (chances + rng.gumbel(size=chances.shape)).argmax(axis=1)
        ways[:, role] = before[:, role] + scene.moves.drawn(cells, situations.ahead, rng)
    return ways


def constant(deviation: float) -> Draws:
    """The first step again and again, plus one deviation for each way [m]."""

    def draw(walk: Walk, count: int, rng: np.random.Generator) -> Array:
        ways = walk.places[1] - walk.places[0] + deviation * rng.standard_normal((count, 2, 2))
        later = np.arange(len(walk.places) - 1)[:, None, None]
        told = np.broadcast_to(walk.places[:1], (count, 1, 2, 2))
        return np.concatenate([told, walk.places[1] + later * ways[:, None]], axis=1)

    return draw


def fitted_deviation(walks: Sequence[Walk]) -> float:
    """Of the mean way of a step of training walks from the first one, by axis [m]."""
    away = list[Vector]()
    for places, seen in walks:
        for role in range(2):
            last = int(seen[:, role].sum()) - 1
            if last > 1:
                away.append((places[last, role] - places[1, role]) / (last - 1) - (places[1, role] - places[0, role]))
    return float(np.sqrt(np.mean(np.square(away))))


def displacements(draws: Draws, walks: Sequence[Walk], count: int, rng: np.random.Generator) -> Away:
    """How far drawn ways are from walks.

    Parameters
    ----------
    draws : Draws
        Of ways.
    walks : Sequence[Walk]
        m of them.
    count : int
        k: from each.
    rng : np.random.Generator
        Of the draws.

    Returns
    -------
    Away
        From step 2 on, while experts are in view.
    """
    average, final = list[Vector](), list[Vector]()
    for walk in walks:
        away = np.linalg.norm(draws(walk, count, rng) - walk.places, axis=-1)
        seen = walk.seen.copy()
        seen[:2] = False
        average.append((away * seen).sum(axis=(1, 2)) / seen.sum())
        lasts = walk.seen.sum(axis=0) - 1
        final.append(away[:, lasts, [0, 1]].mean(axis=1))
    return Away(np.array(average), np.array(final))
