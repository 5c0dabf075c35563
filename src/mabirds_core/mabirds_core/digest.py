"""Digests: how processes and hosts check that they speak of the same game, experiment and schedule."""

import hashlib
import json
from typing import Any

FORMAT = 2
"""Version of what goes into the digests of experiments and games: another version is not another game."""


def digest(content: Any) -> str:
    """SHA-256, in hexadecimal, of the canonical JSON text of ``content`` (sorted keys, no spaces).

    >>> digest({"b": 1, "a": [2.5]}) == digest({"a": [2.5], "b": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def trajectory_digest(kind: str, dynamics: Any, horizon: int) -> str:
    """Digest of what decides a game's trajectories: states, actions and ``dynamics``, over ``horizon`` + 1 steps."""
    return versioned_digest({"game": kind, "dynamics": dynamics, "horizon": horizon})


def versioned_digest(content: Any) -> str:
    """The digest of ``content`` after the format's number.

    >>> versioned_digest([])[:6]
    'v2-4f5'
    """
    return f"v{FORMAT}-{digest(content)}"
