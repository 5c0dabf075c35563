"""From episodes to an experiment and its demonstrations: the game that fits them, and what of them fits it."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mabirds_bringup.importing.area import corners_of
from mabirds_bringup.importing.episodes import Episode, resampled
from mabirds_bringup.importing.rules import ImportRules
from mabirds_bringup.importing.tracks import Findings
from mabirds_core.arrays import Array, Mask
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import GAMES, Experiment, checked
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.recordings import Goal, Observed
from mabirds_core.registry import kinds, require

MARGIN = 0.01
"""By what share the largest speed is larger than was seen."""


LATENESS = 1.25
"""The horizon as a multiple of the longest episode."""


class Demonstrated(NamedTuple):
    """An episode as a demonstration of the game.

    Attributes
    ----------
    episode : Episode
        What was recorded.
    trajectory : Trajectories
        One, of the game.
    places : Array
        Where its experts are at its steps, in the frame of the recording, shape (T + 1, N_E, 2) [m].
    residuals : Array
        Between samples and where the game's experts are at their times, until they have arrived [m].
    """

    episode: Episode
    trajectory: Trajectories
    places: Array
    residuals: Array


def experiment_of(episodes: Sequence[Episode], counts: int, rules: ImportRules, source: str) -> Experiment:
    """The experiment of some episodes.

    Parameters
    ----------
    episodes : Sequence[Episode]
        At least one.
    counts : int
        Demonstrations of each learner.
    rules : ImportRules
        With all that episodes do not tell.
    source : str
        What errors begin with.

    Returns
    -------
    Experiment
        Its bag is called ``bag``.

    Raises
    ------
    ExperimentError
        Recordings cannot be imported to such a game, or a setting is wrong.
    """
    name = rules.game["kind"]
    recorded = require(GAMES, name).recorded
    if recorded is None:
        usable = ", ".join(name for name, kind in kinds(GAMES).items() if kind.recorded)
        raise ExperimentError(f"{source}: game.kind {name}: recordings cannot be imported to it; take one of {usable}")
    content = recorded(observed(episodes, rules))
    content["game"] |= rules.game
    content["demonstrations"] |= {"bag": "bag", "per_learner": counts}
    learners = [f"learner_{number}" for number in range(1, rules.learners.count + 1)]
    content |= {"name": rules.name, "learners": learners, "schedule": {"kind": "static"}, "iterations": counts}
    return checked({**content, **rules.experiment}, source, Path())


def observed(episodes: Sequence[Episode], rules: ImportRules) -> Observed:
    """What episodes tell of a game.

    Parameters
    ----------
    episodes : Sequence[Episode]
        Of which starts, speeds and the horizon are taken.
    rules : ImportRules
        With the rest.

    Returns
    -------
    Observed
        Its numbers are rounded: files are for people.
    """
    low, high = corners_of(rules.area)
    step = rules.steps.time_step
    horizon = rules.steps.horizon or _horizon(episodes, rules)
    starts = np.stack([resampled(episode, step, 1)[0] - low for episode in episodes])
    goals = [
        Goal(_pair(goal.centre - low), goal.radius, None if goal.until is None else _pair(goal.until - low))
        for goal in (expert.goal for expert in rules.experts)
    ]
    speed = rules.steps.max_speed or _fastest(episodes, step, horizon)
    return Observed(_pair(high - low), starts, goals, step, horizon, speed)


def _pair(place: Array) -> tuple[float, float]:
    return round(float(place[0]), 6), round(float(place[1]), 6)


def _horizon(episodes: Sequence[Episode], rules: ImportRules) -> int:
    """What the longest episode needs; longer where agents stay at their goals, so that others may be late."""
    longest = max(_steps(episode, rules.steps.time_step) for episode in episodes)
    return longest if rules.episodes.by in {"length", "pauses"} else int(np.ceil(longest * LATENESS))


def _steps(episode: Episode, time_step: float) -> int:
    return max(1, int(np.ceil((episode.end - episode.begin) / time_step - 1e-9)))


def _fastest(episodes: Sequence[Episode], time_step: float, horizon: int) -> float:
    ways = [np.diff(resampled(episode, time_step, horizon + 2), axis=0) for episode in episodes]
    fastest = max(float(np.hypot(way[..., 0], way[..., 1]).max()) for way in ways) / time_step
    return round(fastest * (1 + MARGIN), 4) or 1.0


def demonstrations_of(
    episodes: Sequence[Episode], experiment: Experiment, rules: ImportRules, findings: Findings
) -> list[Demonstrated]:
    """What of the episodes fits the game.

    Parameters
    ----------
    episodes : Sequence[Episode]
        As recorded.
    experiment : Experiment
        With the game.
    rules : ImportRules
        Of the import.
    findings : Findings
        Is added to.

    Returns
    -------
    list[Demonstrated]
        In the order of the episodes.
    """
    game: Any = build_game(experiment)
    found = list[Demonstrated]()
    for episode in episodes:
        fitted, why = _fitted(episode, game, rules)
        if why:
            findings[f"{episode.source}: episode {why}, dropped"] += 1
        else:
            found.append(fitted)
    return found


def _fitted(episode: Episode, game: Any, rules: ImportRules) -> tuple[Demonstrated, str]:
    """The demonstration, and why it must not be used; "" where it can be."""
    low, high = corners_of(rules.area)
    time_step = rules.steps.time_step
    fit = game.fit_places(resampled(episode, time_step, game.horizon + 2) - low)
    residuals = _residuals(episode, fit.places + low, fit.arrived, time_step)
    result = Demonstrated(episode, fit.trajectory, fit.places + low, residuals)
    start = resampled(episode, time_step, 1)[0]
    if (start < low).any() or (start > high).any():
        return result, "begins outside the area"
    if _steps(episode, time_step) > game.horizon and not fit.arrived[-1].all():
        return result, f"longer than the horizon of {game.horizon} steps"
    limit = rules.limits.residual or game.residual_limit
    if residuals.max(initial=0.0) > limit:
        return result, f"further than {limit:.3g} m from any trajectory of the game (speed, walls)"
    unknown = fit_ends_unknown(episode, fit.arrived, time_step)
    return result, "ends before an agent is at its goal" if unknown else ""


def fit_ends_unknown(episode: Episode, arrived: Mask, time_step: float) -> bool:
    """Is it unknown where an agent is at a step, as it was seen no more and had not arrived?

    Parameters
    ----------
    episode : Episode
        What was recorded.
    arrived : Mask
        Shape (T + 1, N_E).
    time_step : float
        Of the game [s].

    Returns
    -------
    bool
        Agents that rest at the end are known to stay.
    """
    times = episode.begin + time_step * np.arange(len(arrived))
    lasts = np.array([min(episode.end, track.times[-1]) for track in episode.tracks])
    late = times[:, None] > lasts + time_step + 1e-9
    return bool((late & ~arrived).any()) and not episode.rests


def _residuals(episode: Episode, places: Array, arrived: Mask, time_step: float) -> Array:
    """Distances of samples to the trajectory (T + 1, N_E, 2), straight between its steps."""
    times = episode.begin + time_step * np.arange(len(places))
    found = list[Array]()
    for number, track in enumerate(episode.tracks):
        home = arrived[:, number]
        until = min(times[home.argmax()] if home.any() else times[-1], episode.end)
        seen = track.part(episode.begin, until)
        flown = np.column_stack([np.interp(seen.times, times, places[:, number, axis]) for axis in (0, 1)])
        found.append(np.hypot(*(seen.places - flown).T))
    return np.concatenate(found)


def shares(demonstrated: Sequence[Demonstrated], rules: ImportRules) -> Mapping[str, list[Demonstrated]]:
    """Which learner sees which demonstrations, once each.

    Parameters
    ----------
    demonstrated : Sequence[Demonstrated]
        In order.
    rules : ImportRules
        By what they are told apart.

    Returns
    -------
    Mapping[str, list[Demonstrated]]
        By learner.
    """
    rule = rules.learners
    keys = {
        "round_robin": list(map(str, range(len(demonstrated)))),
        "file": [of.episode.source for of in demonstrated],
        "host": [Path(of.episode.source).parent.name for of in demonstrated],
    }[rule.by]
    places = {key: place for place, key in enumerate(dict.fromkeys(keys))}
    found: dict[str, list[Demonstrated]] = {f"learner_{number}": [] for number in range(1, rule.count + 1)}
    for key, of in zip(keys, demonstrated, strict=True):
        found[f"learner_{places[key] % rule.count + 1}"].append(of)
    return found
