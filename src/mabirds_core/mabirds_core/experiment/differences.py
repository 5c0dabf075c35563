"""Which settings two experiments have otherwise, so that nobody has to compare digests."""

import json
from collections.abc import Iterator, Sequence
from typing import Any

from mabirds_core.experiment.file import Experiment, without_defaults
from mabirds_core.texts import sanitize

DECIDING = ("game", "algorithm", "learners", "schedule", "mixing", "iterations", "closing_rounds", "seed")
"""Settings that two processes of one run must have in common."""

SHOWN, MOST = 40, 5
"""Characters of a value that are shown, and settings."""


def settings_lines(experiment: Experiment, run: str) -> list[str]:
    """Settings that decide a run and are not at their defaults, to be compared with those of others.

    Parameters
    ----------
    experiment : Experiment
        Of the run.
    run : str
        Its name.

    Returns
    -------
    list[str]
        Such as 'algorithm.rollouts = 20', one for each number or text.
    """
    content = without_defaults(experiment)
    chosen = {name: content[name] for name in DECIDING if name in content}
    return [f"{name} = {json.dumps(value)}" for name, value in _leaves("", {**chosen, "run": run})]


def _leaves(path: str, content: Any) -> Iterator[tuple[str, Any]]:
    if isinstance(content, dict):
        for name, value in content.items():
            yield from _leaves(f"{path}.{name}" if path else name, value)
    else:
        yield path, content


def differences(theirs: Sequence[str], ours: Sequence[str]) -> str:
    """Say which settings differ.

    Parameters
    ----------
    theirs : Sequence[str]
        Lines as of ``settings_lines``, from anybody.
    ours : Sequence[str]
        The same of this process.

    Returns
    -------
    str
        In words; empty where none do.

    Examples
    --------
    >>> differences(["seed = 4", "iterations = 6"], ["seed = 3", "iterations = 6", "closing_rounds = 2"])
    'closing_rounds is at its default there and 2 here; seed is 4 there and 3 here'
    """
    there, here = (dict(line.partition(" = ")[::2] for line in lines) for lines in (theirs, ours))
    names = sorted(name for name in there.keys() | here.keys() if there.get(name) != here.get(name))
    words = [f"{sanitize(name, SHOWN)} is {_value(there, name)} there and {_value(here, name)} here" for name in names]
    more = [f"{len(words) - MOST} more"] if len(words) > MOST else []
    return "; ".join([*words[:MOST], *more])


def _value(lines: dict[str, str], name: str) -> str:
    return sanitize(lines[name], SHOWN) if name in lines else "at its default"
