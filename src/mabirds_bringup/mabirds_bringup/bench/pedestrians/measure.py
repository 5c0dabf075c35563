"""From tracks to all numbers of the report: import, choose on the training, learn, judge on what was held out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from mabirds_bringup.bench.pedestrians.choosing import LOOKAHEADS, Choice, chosen_settings
from mabirds_bringup.bench.pedestrians.data import AREA, EXITS, HEADINGS, WALLS, Pair, imported, pairs
from mabirds_bringup.bench.pedestrians.features import LEVELS, PlaceGrid, WalkFeatures
from mabirds_bringup.bench.pedestrians.forecasts import Forecast, Training, baselines
from mabirds_bringup.bench.pedestrians.game import StepPolicy
from mabirds_bringup.bench.pedestrians.judging import Judged, judged, pigeonhole_weights
from mabirds_bringup.bench.pedestrians.learning import Network
from mabirds_bringup.bench.pedestrians.moves import Moves
from mabirds_bringup.bench.pedestrians.situations import decisions
from mabirds_bringup.bench.pedestrians.walking import Scene, constant, displacements, fitted_deviation
from mabirds_bringup.evaluate.recordings import LEARNERS
from mabirds_bringup.importing.tracks import Track
from mabirds_core.arrays import Array, Vector

AIMS, SPOTS = 1.5, 1.0
"""Between the points of places of f and of phi [m]."""

CONSTANT = "constant velocity"

TOLD = "constant velocity, deviation told"
"""The same with the deviation that is best on the held-out pairs themselves, which nobody can know."""

DEVIATIONS = (0.25, 0.5, 0.75, 1.0, 1.5)
"""Of constant velocity, as multiples of what the training deviates, of which the best on the training is taken."""

MARGIN = np.array([1.5, 0.4])
"""By which points of places are outside the area, in which half a wall is [m]."""

NEAR_WALL = 0.75
"""Within which a point is at a wall [m]."""


class Sizes(NamedTuple):
    """How much is computed."""

    iterations: int
    folds: int
    samples: int
    seed: int

    @property
    def runs(self) -> int:
        """How often something is learned, and forecasts are judged: for progress."""
        return self.folds * len(LOOKAHEADS) + 1 + 9


class Findings(NamedTuple):
    """What the report is made of.

    Attributes
    ----------
    choice : Choice
        Of settings.
    judged : Judged
        On held-out pairs, the learners' mean and each of them among the rest.
    policies : Mapping[str, StepPolicy]
        By learner.
    training, held_out : list[Pair]
        Who walks.
    deviation : float
        Of constant velocity [m].
    imported : Mapping[str, int]
        What the import found.
    """

    choice: Choice
    judged: Judged
    policies: Mapping[str, StepPolicy]
    training: list[Pair]
    held_out: list[Pair]
    deviation: float
    imported: Mapping[str, int]


def features_over(moves: Moves) -> WalkFeatures:
    """Features over the area."""
    wide = tuple(AREA[0] - MARGIN), tuple(AREA[1] + MARGIN)
    return WalkFeatures(moves, HEADINGS, PlaceGrid(*wide, AIMS), PlaceGrid(*wide, SPOTS))


def measured(tracks: Sequence[Track], sizes: Sizes, on_run: Callable[[], None] = lambda: None) -> Findings:
    """Do everything.

    Parameters
    ----------
    tracks : Sequence[Track]
        Of all people.
    sizes : Sizes
        How much of it.
    on_run : Callable, optional
        Is called ``sizes.runs`` times.

    Returns
    -------
    Findings
        What came out.
    """
    found = imported(tracks)
    by_learner = {name: pairs(of) for name, of in found.learned.items()}
    training = sorted((pair for of in by_learner.values() for pair in of), key=lambda pair: pair.begin)
    held_out, features = pairs(found.held_out), features_over(Moves())
    choice = chosen_settings(training, features, found.experiment, sizes.iterations, sizes.folds, on_run)
    features = replace(features, lookahead=choice.lookahead)
    walks = {name: [pair.walk for pair in of] for name, of in by_learner.items()}
    history = Network(features, walks, found.experiment).learn(choice.iterations)
    on_run()
    policies = {name: StepPolicy(features, *of[-1]) for name, of in history.items()}
    by_name, deviation = _judge(policies, training, held_out, sizes, on_run)
    weights = pigeonhole_weights(held_out, sizes.seed)
    return Findings(choice, Judged(by_name, weights), policies, training, held_out, deviation, found.findings)


def _judge(
    policies: Mapping[str, StepPolicy],
    training: Sequence[Pair],
    held_out: Sequence[Pair],
    sizes: Sizes,
    on_forecast: Callable[[], None],
) -> tuple[dict[str, Array], float]:
    """Values by forecast, those of the learners' mean first, and the deviation of constant velocity."""
    features = next(iter(policies.values())).features
    scene = Scene(features.moves, HEADINGS, *AREA)
    situations, chosen, _ = decisions([pair.walk for pair in training], scene.moves, HEADINGS)
    deviation = best_deviation(training, sizes)
    forecasts: dict[str, Forecast] = {
        **policies,
        **baselines(scene.moves, HEADINGS, EXITS, Training(situations, chosen)),
    }
    forecasts[TOLD] = forecasts[CONSTANT]
    ways = {CONSTANT: constant(deviation), TOLD: constant(best_deviation(held_out, sizes))}
    values = judged(forecasts, ways, held_out, scene, sizes.samples, sizes.seed, on_forecast)
    mean = np.mean([values[name] for name in policies], axis=0)
    return {LEARNERS: mean, **values}, deviation


def best_deviation(pairs_shown: Sequence[Pair], sizes: Sizes) -> float:
    """With which constant velocity's best way is nearest to what pairs show [m]."""
    walks = [pair.walk for pair in pairs_shown]
    tried = [factor * fitted_deviation(walks) for factor in DEVIATIONS]

    def average(deviation: float) -> float:
        rng = np.random.default_rng(sizes.seed)
        return float(displacements(constant(deviation), walks, sizes.samples, rng).average.min(axis=1).mean())

    return min(tried, key=average)


def mean_costs(policies: Mapping[str, StepPolicy]) -> tuple[Vector, Vector]:
    """What learners take places and nearness to cost, mean over learners.

    Parameters
    ----------
    policies : Mapping[str, StepPolicy]
        By learner.

    Returns
    -------
    places : Vector
        At the points of phi, both of phi and of f, there as mean over roles [nats].
    nearness : Vector
        Of the levels [nats].
    """
    features = next(iter(policies.values())).features
    omega = np.mean([of.omega for of in policies.values()], axis=0)
    theta = np.mean([of.theta for of in policies.values()], axis=0)
    aims = theta[-2 * features.aims.size :].reshape(2, -1).mean(axis=0)
    of_aims = sum(aims[at] * weights for at, weights in features.aims.corners(features.spots.points))
    return -(omega[: features.spots.size] + of_aims), -omega[-len(LEVELS) :]


def wall_cost(findings: Findings) -> float:
    """By how much places at walls cost more than where people walk, mean over points [nats]."""
    features = next(iter(findings.policies.values())).features
    points, (places, _) = features.spots.points, mean_costs(findings.policies)
    walked = np.zeros(features.spots.size)
    for pair in findings.training:
        for at, weights in features.spots.corners(pair.walk.places[pair.walk.seen]):
            np.add.at(walked, at, weights)
    at_wall = (distances(points, WALLS) <= NEAR_WALL) & (points[:, 0] >= AREA[0][0] - SPOTS)
    return float(places[at_wall].mean() - places @ walked / walked.sum())


def distances(points: Array, segments: Array) -> Vector:
    """Of points (M, 2) to the nearest of some segments, shape (M,) [m]."""
    begin, way = segments[:, :2], segments[:, 2:] - segments[:, :2]
    along = ((points[:, None] - begin) * way).sum(axis=-1) / (way**2).sum(axis=-1)
    nearest = begin + np.clip(along, 0.0, 1.0)[..., None] * way
    return np.asarray(np.linalg.norm(points[:, None] - nearest, axis=-1).min(axis=1))
