"""An import from beginning to end, without files: from tracks to demonstrations for learners."""

from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from mabirds_bringup.importing.episodes import Episode, episodes
from mabirds_bringup.importing.fitting import Demonstrated, demonstrations_of, experiment_of, shares
from mabirds_bringup.importing.rules import ImportRules
from mabirds_bringup.importing.tracks import Findings, Track, cleaned, swaps
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py.errors import BagError


class Import(NamedTuple):
    """What was made of recordings.

    Attributes
    ----------
    experiment : Experiment
        Ready to be learned.
    learned : Mapping[str, list[Demonstrated]]
        By learner, each as many, in the order in which they are seen; of one pass.
    held_out : list[Demonstrated]
        From which nobody learns.
    findings : Findings
        What was doubtful or dropped, counted.
    tracks : list[Track]
        All stretches that could be used.
    """

    experiment: Experiment
    learned: Mapping[str, list[Demonstrated]]
    held_out: list[Demonstrated]
    findings: Findings
    tracks: list[Track]

    @property
    def demonstrations(self) -> list[Demonstrated]:
        """All, those of learners first."""
        return [*(of for stream in self.learned.values() for of in stream), *self.held_out]

    def content(self) -> dict[str, Any]:
        """What is told of it, as JSON."""
        residuals = np.concatenate([of.residuals for of in self.demonstrations])
        return {
            "demonstrations": {name: len(stream) for name, stream in self.learned.items()},
            "held_out": len(self.held_out),
            "horizon": self.experiment.game.horizon,
            "residual_mean": float(residuals.mean()),
            "residual_95": float(np.quantile(residuals, 0.95)),
            "residual_max": float(residuals.max()),
            "findings": dict(self.findings),
        }


def import_tracks(tracks: Iterable[Track], rules: ImportRules, source: str) -> Import:
    """Make demonstrations of tracks.

    Parameters
    ----------
    tracks : Iterable[Track]
        Of one recording after the other.
    rules : ImportRules
        What is to be made of them.
    source : str
        What errors about settings begin with: the file of rules.

    Returns
    -------
    Import
        With the report.

    Raises
    ------
    BagError
        An agent is missing, or nothing is left.
    """
    findings, usable, found = Findings(), list[Track](), list[Episode]()
    for recording, group in groupby(tracks, key=lambda track: track.source):
        of_recording = list(group)
        stretches = _stretches(of_recording, rules, findings)
        found += episodes(recording, stretches, rules, findings)
        usable += [track for parts in stretches.values() for track in parts]
    if not found:
        raise BagError(f"no episode by {rules.episodes.by} was found{_because(findings)}; look at regions and limits")
    learning, judging = _by_time(found, rules.held_out)
    experiment = experiment_of([*learning, *judging], 1, rules, source)
    learned = shares(demonstrations_of(learning, experiment, rules, findings), rules)
    learned = _equal(learned, findings)
    count = min(map(len, learned.values())) * rules.learners.passes
    if not count:
        raise BagError(f"a learner has no demonstration{_because(findings)}; take fewer learners, or loosen limits")
    held_out = demonstrations_of(judging, experiment, rules, findings)
    whole = experiment_of([*learning, *judging], count, rules, source)
    return Import(whole, learned, held_out, findings, usable)


def _stretches(tracks: Sequence[Track], rules: ImportRules, findings: Findings) -> dict[str, list[Track]]:
    """What can be used of each agent; swapped names cut the tracks, as they are jumps of both."""
    for one, other, time in swaps(tracks, rules.limits.speed):
        findings[f"{tracks[0].source}: {one} and {other} seem to be swapped, first at {time:.2f} s; cut there"] += 1
    return {track.agent: cleaned(track, rules.limits, findings) for track in tracks}


def _by_time(found: Sequence[Episode], held_out: float) -> tuple[list[Episode], list[Episode]]:
    """Episodes that end before a share of the time is left, and those that begin after; none is in both."""
    if not held_out:
        return list(found), []
    first, last = min(episode.begin for episode in found), max(episode.end for episode in found)
    border = first + (1 - held_out) * (last - first)
    return [of for of in found if of.end <= border], [of for of in found if of.begin > border]


def _equal(learned: Mapping[str, list[Demonstrated]], findings: Findings) -> dict[str, list[Demonstrated]]:
    """As many for each learner: an iteration takes one of each."""
    least = min(map(len, learned.values()))
    if beyond := sum(len(stream) - least for stream in learned.values()):
        findings[f"demonstration beyond the {least} that every learner has, left out"] += beyond
    return {name: stream[:least] for name, stream in learned.items()}


def _because(findings: Findings) -> str:
    words = "; ".join(f"{what}: {count}" for what, count in findings.most_common(8))
    return f" ({words})" if words else ""
