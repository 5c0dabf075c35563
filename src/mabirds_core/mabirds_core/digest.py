"""Digests: how processes and hosts check that they speak of the same game, experiment and schedule."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mabirds_core.arrays import Array

GAME_FORMAT, EXPERIMENT_FORMAT = 2, 3
"""Versions of what goes into the digests: another version is not another game. Raised where a default changes."""


def digest(content: Any) -> str:
    """SHA-256, in hexadecimal, of the canonical JSON text of ``content`` (sorted keys, no spaces).

    >>> digest({"b": 1, "a": [2.5]}) == digest({"a": [2.5], "b": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def trajectory_digest(kind: str, dynamics: Any, horizon: int) -> str:
    """Digest of what decides a game's trajectories.

    Parameters
    ----------
    kind : str
        Of the game.
    dynamics : Any
        States, actions and what follows them, as JSON can write them.
    horizon : int
        T.

    Returns
    -------
    str
        With the version of its format.
    """
    return _versioned(GAME_FORMAT, {"game": kind, "dynamics": dynamics, "horizon": horizon})


def experiment_digest(content: Any) -> str:
    """The digest of an experiment's settings, or of one run of it.

    >>> experiment_digest([])[:6]
    'v3-4f5'
    """
    return _versioned(EXPERIMENT_FORMAT, content)


def arrays_digest(arrays: Iterable[Array]) -> str:
    """SHA-256 of arrays: of their shapes, and of every bit of their numbers as float64.

    >>> arrays_digest([np.zeros(2)]) == arrays_digest([np.zeros(2, dtype=int)]) != arrays_digest([-np.zeros(2)])
    True
    """
    total = hashlib.sha256()
    for values in arrays:
        total.update(f"{values.shape} ".encode())
        total.update(np.ascontiguousarray(values, dtype=np.float64).tobytes())
    return total.hexdigest()


def demonstrations_digest(streams: Mapping[str, Iterable[Iterable[Array]]]) -> str:
    """Digest of what learners are shown: of the content of their demonstrations, not of times or files.

    Parameters
    ----------
    streams : Mapping[str, Iterable[Iterable[Array]]]
        By learner its demonstrations, each of states and actions.

    Returns
    -------
    str
        SHA-256, in hexadecimal.

    Examples
    --------
    >>> one, two = [np.zeros(2)], [np.ones(2)]
    >>> demonstrations_digest({"a": [one, two]}) == demonstrations_digest({"a": [two, one]})
    False
    """
    return digest({name: [arrays_digest(shown) for shown in stream] for name, stream in streams.items()})


def _versioned(number: int, content: Any) -> str:
    return f"v{number}-{digest(content)}"
