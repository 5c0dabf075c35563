"""What was recorded of one agent, and what is wrong with it: every fault is counted by its name."""

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from mabirds_bringup.importing.rules import LimitRule
from mabirds_core.arrays import Array, Mask, Vector

Findings = Counter[str]
"""How often something was found, by what it is, in words."""


class Track(NamedTuple):
    """Places of one agent in the order of time.

    Attributes
    ----------
    source : str
        The recording.
    agent : str
        Topic, child frame or id.
    times : Vector
        Shape (n,) [s].
    places : Array
        Shape (n, 2) [m].
    """

    source: str
    agent: str
    times: Vector
    places: Array

    def at(self, times: Vector) -> Array:
        """Places at other times, straight between samples and at rest beyond them, shape (m, 2)."""
        return np.column_stack([np.interp(times, self.times, self.places[:, axis]) for axis in (0, 1)])

    def part(self, begin: float, end: float) -> "Track":
        """What was recorded from one time to another, both included."""
        inside = (self.times >= begin) & (self.times <= end)
        return self._replace(times=self.times[inside], places=self.places[inside])


def cleaned(track: Track, limits: LimitRule, findings: Findings) -> list[Track]:
    """The stretches of a track that can be used.

    Parameters
    ----------
    track : Track
        As recorded.
    limits : LimitRule
        What is a gap and what a jump.
    findings : Findings
        Is added to.

    Returns
    -------
    list[Track]
        Of at least two samples each, in the order of time, without gaps and jumps.
    """
    track = _in_order(_finite(track, findings), findings)
    track = _without_outliers(track, limits.speed, findings)
    return _uncut(track, limits, findings)


def _finite(track: Track, findings: Findings) -> Track:
    finite = np.isfinite(track.times) & np.isfinite(track.places).all(axis=1)
    return _kept(track, finite, "sample with a number that is none (NaN)", findings)


def _in_order(track: Track, findings: Findings) -> Track:
    """Without samples that are not later than all before them."""
    if not len(track.times):
        return track
    latest = np.maximum.accumulate(track.times)
    later = np.concatenate([[True], track.times[1:] > latest[:-1]])
    return _kept(track, later, "sample whose time repeats or goes back", findings)


def _without_outliers(track: Track, speed: float, findings: Findings) -> Track:
    """Without single samples away from both neighbours, which are near each other."""
    if len(track.times) < 3:
        return track
    fast = _speeds(track) > speed
    across = np.hypot(*(track.places[2:] - track.places[:-2]).T) / (track.times[2:] - track.times[:-2])
    single = np.concatenate([[False], fast[:-1] & fast[1:] & (across <= speed), [False]])
    return _kept(track, ~single, "single sample far from its neighbours", findings)


def _uncut(track: Track, limits: LimitRule, findings: Findings) -> list[Track]:
    steps = np.diff(track.times)
    gaps, jumps = steps > limits.gap, (_speeds(track) > limits.speed) & (steps <= limits.gap)
    _count(findings, track, f"gap of more than {limits.gap:g} s, at which the track is cut", gaps.sum())
    _count(findings, track, f"jump faster than {limits.speed:g} m/s, at which the track is cut", jumps.sum())
    pieces = np.split(np.arange(len(track.times)), np.flatnonzero(gaps | jumps) + 1)
    return [track._replace(times=track.times[of], places=track.places[of]) for of in pieces if len(of) > 1]


def _speeds(track: Track) -> Vector:
    return np.asarray(np.hypot(*np.diff(track.places, axis=0).T) / np.diff(track.times))


def _kept(track: Track, keep: Mask, what: str, findings: Findings) -> Track:
    _count(findings, track, what, int((~keep).sum()))
    return track._replace(times=track.times[keep], places=track.places[keep])


def _count(findings: Findings, track: Track, what: str, count: int) -> None:
    if count:
        findings[f"{track.source}: {track.agent}: {what}"] += int(count)


def swaps(tracks: Sequence[Track], speed: float) -> Iterator[tuple[str, str, float]]:
    """Where two agents seem to have changed names: both jump at once, each to where the other was.

    Parameters
    ----------
    tracks : Sequence[Track]
        Of one recording.
    speed : float
        Faster is a jump [m/s].

    Yields
    ------
    tuple[str, str, float]
        Two agents, and when [s].
    """
    jumps = [(track, k) for track in tracks for k in np.flatnonzero(_speeds_or_none(track) > speed)]
    for number, (one, k) in enumerate(jumps):
        for other, j in jumps[:number]:
            step = max(one.times[k + 1] - one.times[k], other.times[j + 1] - other.times[j])
            if one.agent == other.agent or abs(one.times[k] - other.times[j]) > step:
                continue
            crossed = (one.places[k + 1] - other.places[j], other.places[j + 1] - one.places[k])
            if max(np.hypot(*way) for way in crossed) <= speed * 2 * step:
                yield other.agent, one.agent, float(one.times[k])


def _speeds_or_none(track: Track) -> Vector:
    """Speeds between samples; 0 where time or place is no number or time does not go on."""
    with np.errstate(all="ignore"):
        return np.nan_to_num(np.where(np.diff(track.times) > 0, _speeds(track), 0.0))
