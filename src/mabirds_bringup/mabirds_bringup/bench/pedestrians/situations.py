"""What walkers see when they take a step, and what they do: one row for each step of each expert.

A step is a decision. Its state is where the expert is, the way of its last step, and the same of the other expert.
The first step of each expert is told to everybody, as the way of a step before is needed.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from mabirds_bringup.bench.pedestrians.moves import Moves
from mabirds_bringup.importing.episodes import Episode, resampled
from mabirds_core.arrays import Array, Indices, Mask

SLOW = 0.05
"""Who goes less in a step looks where its role goes [m]."""


class Walk(NamedTuple):
    """What two experts did, at the steps 0 .. L.

    Attributes
    ----------
    places : Array
        Shape (L + 1, 2, 2) [m]: step, expert, x and y.
    seen : Mask
        Which experts are in view, shape (L + 1, 2).
    """

    places: Array
    seen: Mask


class Situations(NamedTuple):
    """M decisions.

    Attributes
    ----------
    role : Indices
        Which expert decides, shape (M,).
    places, before : Array
        Where it is, and the way of its last step, shape (M, 2) [m].
    other_places, other_before : Array
        The same of the other one, shape (M, 2) [m].
    met : Mask
        Is the other one in view? Shape (M,).
    ahead : Array
        Where it looks, unit vectors, shape (M, 2).
    """

    role: Indices
    places: Array
    before: Array
    other_places: Array
    other_before: Array
    met: Mask
    ahead: Array

    @property
    def size(self) -> int:
        """M."""
        return len(self.role)

    def of(self, rows: Mask) -> "Situations":
        """Some of them."""
        parts: Any = (part[rows] for part in self)
        return Situations(*parts)


def walk_of(episode: Episode, time_step: float) -> Walk:
    """Sample an episode.

    Parameters
    ----------
    episode : Episode
        Of two experts.
    time_step : float
        Of the game [s].

    Returns
    -------
    Walk
        Experts are in view until their last sample.
    """
    steps = int((episode.end - episode.begin) / time_step + 1e-9) + 1
    times = episode.begin + time_step * np.arange(steps)
    lasts = np.array([track.times[-1] for track in episode.tracks])
    return Walk(resampled(episode, time_step, steps), times[:, None] <= lasts + 1e-9)


def looking(role: Indices, before: Array, headings: Array) -> Array:
    """Where walkers look: along their last way, or where their role goes, unit vectors, shape (M, 2)."""
    lengths = np.hypot(*before.T)[:, None]
    return np.asarray(np.where(lengths > SLOW, before / np.maximum(lengths, SLOW), headings[role]))


def seen_from(role: int, places: Array, before: Array, seen: Mask, headings: Array) -> Situations:
    """The situations of one expert.

    Parameters
    ----------
    role : int
        Which of the two.
    places, before : Array
        Of both, shape (M, 2, 2) [m].
    seen : Mask
        Shape (M, 2).
    headings : Array
        Where each role goes, unit vectors, shape (2, 2).

    Returns
    -------
    Situations
        M of them.
    """
    roles, other = np.full(len(places), role), 1 - role
    ahead = looking(roles, before[:, role], headings)
    return Situations(
        roles, places[:, role], before[:, role], places[:, other], before[:, other], seen[:, other], ahead
    )


def decisions(walks: Sequence[Walk], moves: Moves, headings: Array) -> tuple[Situations, Indices, Indices]:
    """All decisions of walks.

    Parameters
    ----------
    walks : Sequence[Walk]
        At least one.
    moves : Moves
        To choose of.
    headings : Array
        Where each role goes, unit vectors, shape (2, 2).

    Returns
    -------
    Situations
        M of them.
    chosen : Indices
        The move in each, shape (M,).
    walk : Indices
        Of which walk each is, shape (M,).
    """
    found, chosen, whose = list[Situations](), list[Indices](), list[Indices]()
    for number, (places, seen) in enumerate(walks):
        ways = np.diff(places, axis=0)
        for role in range(2):
            taken = seen[2:, role]
            here = seen_from(role, places[1:-1], ways[:-1], seen[1:-1], headings)
            found.append(here.of(taken))
            deviations = (ways[1:, role] - ways[:-1, role])[taken]
            chosen.append(moves.chosen(deviations, found[-1].ahead))
            whose.append(np.full(found[-1].size, number))
    return (
        Situations(*(np.concatenate(of) for of in zip(*found, strict=True))),
        np.concatenate(chosen),
        np.concatenate(whose),
    )
