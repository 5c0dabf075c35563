"""Cutting recordings into episodes: who takes part, from when to when."""

from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np

from mabirds_bringup.importing.rules import HEADINGS, ImportRules, Region
from mabirds_bringup.importing.tracks import Findings, Track
from mabirds_core.arrays import Array, Mask, Vector
from mabirds_msgs_py.errors import BagError


class Episode(NamedTuple):
    """A stretch of time with one track per expert.

    Attributes
    ----------
    source : str
        The recording.
    begin : float
        [s]
    end : float
        [s]
    tracks : tuple[Track, ...]
        Of the experts in turn; what is after an agent's last sample is not known.
    rests : bool
        Are agents known to stay where they are at the end?
    """

    source: str
    begin: float
    end: float
    tracks: tuple[Track, ...]
    rests: bool


Stretches = Mapping[str, Sequence[Track]]
"""What can be used of each agent of a recording, by its name."""


def episodes(source: str, stretches: Stretches, rules: ImportRules, findings: Findings) -> list[Episode]:
    """All episodes of a recording.

    Parameters
    ----------
    source : str
        The recording.
    stretches : Stretches
        Of its agents.
    rules : ImportRules
        Who is an expert, and how recordings are cut.
    findings : Findings
        Is added to.

    Returns
    -------
    list[Episode]
        In the order of time.

    Raises
    ------
    BagError
        An expert is not in the recording.
    """
    if rules.episodes.by == "together":
        found = _together(source, stretches, rules, findings)
    else:
        found = [
            episode
            for tracks in _all_present(source, stretches, rules, findings)
            for episode in CUTS[rules.episodes.by](source, tracks, rules)
        ]
    long = [episode for episode in found if episode.end - episode.begin >= rules.episodes.shortest]
    if dropped := len(found) - len(long):
        findings[f"{source}: episode shorter than {rules.episodes.shortest:g} s, dropped"] += dropped
    return sorted(long, key=lambda episode: episode.begin)


def _all_present(
    source: str, stretches: Stretches, rules: ImportRules, findings: Findings
) -> Iterator[tuple[Track, ...]]:
    """Parts of the recording in which nobody's track is cut."""
    names = [str(expert.agent) for expert in rules.experts]
    if missing := [name for name in names if not stretches.get(name)]:
        there = ", ".join(sorted(stretches)) or "nobody"
        raise BagError(f"{source}: no places of {', '.join(missing)}; there is {there}; correct experts.agent")
    seen, whole = 0.0, sum(track.times[-1] - track.times[0] for track in stretches[names[0]])
    for tracks in _overlapping([stretches[name] for name in names]):
        begin, end = _span(tracks)
        seen += end - begin
        yield tuple(track.part(begin, end) for track in tracks)
    if not seen:
        spans = ((name, stretches[name][0].times[0], stretches[name][-1].times[-1]) for name in names)
        words = ", ".join(f"{name} from {first:.3f} to {last:.3f} s" for name, first, last in spans)
        raise BagError(f"{source}: agents are never seen at one time: {words}; are their clocks apart?")
    if whole - seen > rules.limits.gap:
        findings[f"{source}: seconds without one of the agents, dropped"] += round(whole - seen)


def _overlapping(by_agent: Sequence[Sequence[Track]]) -> list[tuple[Track, ...]]:
    """One stretch of each agent, all of which are seen at one time."""
    found: list[tuple[Track, ...]] = [()]
    for stretches in by_agent:
        longer = [(*tracks, track) for tracks in found for track in stretches]
        found = [tracks for tracks in longer if _span(tracks)[0] < _span(tracks)[1]]
    return found


def _span(tracks: Sequence[Track]) -> tuple[float, float]:
    """When all are seen; the end is before the beginning where they are not."""
    return max(track.times[0] for track in tracks), min(track.times[-1] for track in tracks)


def _times(tracks: Sequence[Track], rules: ImportRules) -> Vector:
    begin, end = _span(tracks)
    return np.arange(begin, end + 1e-9, rules.steps.time_step / 2)


def _within(track: Track, times: Vector, region: Region) -> Mask:
    return np.asarray(np.hypot(*(track.at(times) - region.centre).T) <= region.radius)


def _by_regions(source: str, tracks: tuple[Track, ...], rules: ImportRules) -> Iterator[Episode]:
    """From when all were in their `enter` regions for the last time, until all have been in their goals."""
    times = _times(tracks, rules)
    pairs = list(zip(tracks, rules.experts, strict=True))
    ready = np.all([_within(track, times, expert.enter) for track, expert in pairs if expert.enter], axis=0)
    there = np.array([_within(track, times, expert.goal) for track, expert in pairs])
    leaves = np.flatnonzero(ready[:-1] & ~ready[1:])
    for first, following in pairwise([*leaves, len(times) - 1]):
        arrived = np.maximum.accumulate(there[:, first : following + 1], axis=1).all(axis=0)
        if arrived.any():
            yield Episode(source, times[first], times[first + arrived.argmax()], tracks, rests=False)


def _by_pauses(source: str, tracks: tuple[Track, ...], rules: ImportRules) -> Iterator[Episode]:
    """Between stretches in which all are slower than `pause_speed` for as long as `pause`."""
    times, rule = _times(tracks, rules), rules.episodes
    if len(times) < 2:
        return
    speeds = [np.hypot(*np.diff(track.at(times), axis=0).T) / np.diff(times) for track in tracks]
    slow = np.concatenate([[False], (np.max(speeds, axis=0) < rule.pause_speed), [False]])
    edges = np.flatnonzero(slow[1:] != slow[:-1])
    pauses = [(a, b) for a, b in edges.reshape(-1, 2) if times[b] - times[a] >= rule.pause]
    borders = [(0, 0), *pauses, (len(times) - 1, len(times) - 1)]
    for (_, begin), (end, until) in pairwise(borders):
        if end > begin:
            yield Episode(source, times[begin], times[end], tracks, rests=until > end)


def _by_length(source: str, tracks: tuple[Track, ...], rules: ImportRules) -> Iterator[Episode]:
    times, length = _times(tracks, rules), rules.episodes.length
    for begin in np.arange(times[0], times[-1] - length + 1e-9, length):
        yield Episode(source, begin, begin + length, tracks, rests=False)


CUTS: Mapping[str, Callable[[str, tuple[Track, ...], ImportRules], Iterator[Episode]]] = {
    "regions": _by_regions,
    "pauses": _by_pauses,
    "length": _by_length,
}


def _together(source: str, stretches: Stretches, rules: ImportRules, findings: Findings) -> list[Episode]:
    """Agents of the experts' roles that are in view at one time, the longest together first."""
    roles = _roles(stretches)
    findings[f"{source}: agents"] += len(stretches)
    casts = [cast for cast in product(*(roles[str(expert.heads)] for expert in rules.experts)) if _different(cast)]
    found = [episode for cast in casts if (episode := _shared(source, cast)) is not None]
    if rules.episodes.reuse:
        return found
    taken, kept = set[tuple[str, float]](), list[Episode]()
    for episode in sorted(found, key=_together_for, reverse=True):
        cast_of = {(track.agent, track.times[0]) for track in episode.tracks}
        if not cast_of & taken:
            kept.append(episode)
            taken |= cast_of
    return kept


def _roles(stretches: Stretches) -> Mapping[str, list[Track]]:
    """Tracks by the direction in which they go most of all."""
    roles = defaultdict[str, list[Track]](list)
    for track in (track for tracks in stretches.values() for track in tracks):
        way = track.places[-1] - track.places[0]
        roles[max(HEADINGS, key=lambda name: float(np.dot(HEADINGS[name], way)))].append(track)
    return roles


def _different(cast: Sequence[Track]) -> bool:
    return len({track.agent for track in cast}) == len(cast)


def _shared(source: str, cast: tuple[Track, ...]) -> Episode | None:
    """From when all are in view, until the last of them goes; None where they are never in view together."""
    begin = max(track.times[0] for track in cast)
    if begin >= min(track.times[-1] for track in cast):
        return None
    return Episode(source, begin, max(track.times[-1] for track in cast), cast, rests=False)


def _together_for(episode: Episode) -> float:
    return float(min(track.times[-1] for track in episode.tracks) - episode.begin)


def resampled(episode: Episode, time_step: float, steps: int) -> Array:
    """Places of all experts at the steps of a game.

    Parameters
    ----------
    episode : Episode
        What was recorded.
    time_step : float
        Of the game [s].
    steps : int
        How many places.

    Returns
    -------
    Array
        Shape (steps, N_E, 2) [m]; beyond the end, experts stay.
    """
    times = np.minimum(episode.begin + time_step * np.arange(steps), episode.end)
    return np.stack([track.at(times) for track in episode.tracks], axis=1)
