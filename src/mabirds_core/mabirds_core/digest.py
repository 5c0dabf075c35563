"""Digests: how processes and hosts check that they speak of the same game, experiment and schedule."""

import hashlib
import json
from typing import Any


def digest(content: Any) -> str:
    """SHA-256, in hexadecimal, of the canonical JSON text of ``content`` (sorted keys, no spaces).

    >>> digest({"b": 1, "a": [2.5]}) == digest({"a": [2.5], "b": 1})
    True
    """
    text = json.dumps(content, sort_keys=True, separators=(",", ":"), allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()
