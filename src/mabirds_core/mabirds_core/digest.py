"""Digests: how processes and hosts check that they speak of the same game, experiment and schedule."""

import hashlib
import json
from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from mabirds_core.arithmetic import arithmetic
from mabirds_core.arrays import Array
from mabirds_core.texts import truncate

GAME_FORMAT, EXPERIMENT_FORMAT = 2, 4
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


def experiment_digest(content: Any, arithmetic_name: str | None = None) -> str:
    """The digest of an experiment's settings, or of one run of it, with the arithmetic that it is learned in.

    Parameters
    ----------
    content : Any
        As JSON can write it.
    arithmetic_name : str, optional
        Without "-"; default: that of this process.

    Returns
    -------
    str
        With the version of its format.

    Examples
    --------
    >>> experiment_digest([], "fixed")[:12]
    'v4-fixed-4f5'
    """
    return f"v{EXPERIMENT_FORMAT}-{arithmetic_name or arithmetic()}-{digest(content)}"


def arithmetic_differs(given: str, expected: str) -> str | None:
    """Say why two digests of one experiment are not the same, where it is the arithmetic alone.

    Parameters
    ----------
    given : str
        Somebody else's, any text.
    expected : str
        Our own.

    Returns
    -------
    str or None
        None: they are the same, or differ in more.

    Examples
    --------
    >>> arithmetic_differs(experiment_digest([], "numpy_1"), experiment_digest([1], "fixed")) is None
    True
    """
    theirs, ours = given.split("-"), expected.split("-")
    if len(theirs) != 3 or len(ours) != 3 or theirs[1] == ours[1] or theirs[::2] != ours[::2]:
        return None
    return (
        f"arithmetic {truncate(theirs[1])!r}, expected {ours[1]!r}: last bits would differ; install mabirds_core with"
        " compiled kernels on all hosts"
    )


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
