"""The player's parameters: their names, defaults, ranges and meanings, and what is made of them."""

import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from rclpy.node import Node
from rclpy.parameter import Parameter

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment
from mabirds_expert_player.play_clock import ENDLESS
from mabirds_expert_player.playback import Part, Recording
from mabirds_msgs_py.conversion import NANOSECONDS
from mabirds_msgs_py.ros_parameters import (
    Numbers,
    bool_param,
    declare_experiment,
    float_param,
    int_param,
    str_param,
    strings_param,
)

HISTORY = 256
"""Depth of the demonstration topics: what a late joiner still gets."""

MIN_RATE, MAX_RATE = 1e-6, 1e9
"""Speeds. At the largest nothing is waited for but the learners."""

MAX_SECONDS = 1e9
"""Some thirty years."""


def declare_parameters(node: Node) -> None:
    """Declare all parameters of a player."""
    declare_experiment(node)
    numbers = Numbers(node)
    for name, (default, lowest, highest, description) in NUMBERS.items():
        changes = name in ("rate", "hz")
        numbers.declare(name, default, float_param(description, lowest, highest, fixed=not changes))
    for name, (whole, least, most, description) in WHOLE_NUMBERS.items():
        node.declare_parameter(name, whole, int_param(description, least, most))
    for name, description in FLAGS.items():
        node.declare_parameter(name, False, bool_param(description))  # noqa: FBT003 - the default
    for name, description in TEXTS.items():
        node.declare_parameter(name, "", str_param(description))
    for name, description in LISTS.items():
        node.declare_parameter(name, Parameter.Type.STRING_ARRAY, strings_param(description))


NUMBERS = {
    "rate": (1.0, MIN_RATE, MAX_RATE, "speed, as a multiple of the recorded timing"),
    "hz": (0.0, 0.0, MAX_RATE, "demonstrations per second; 0: the recorded timing times rate"),
    "delay": (0.0, 0.0, MAX_SECONDS, "seconds to wait before the first demonstration"),
    "start_offset": (
        0.0,
        0.0,
        MAX_SECONDS,
        "recorded seconds to leave out first; learners get them at once",
    ),
    "playback_duration": (0.0, 0.0, MAX_SECONDS, "recorded seconds to play; 0: all"),
    "playback_until": (0.0, 0.0, MAX_SECONDS, "recorded seconds after the beginning at which to end; 0: all"),
    "max_gap": (0.0, 0.0, MAX_SECONDS, "recorded seconds to which longer pauses are shortened; 0: none is"),
    "clock": (0.0, 0.0, 1e4, "how often a second the recorded time goes to /clock; 0: never"),
    "wait_for_all_acked": (
        -1.0,
        -1.0,
        MAX_SECONDS,
        "seconds to wait at the end until all who hear have all; -1: none",
    ),
}
"""By name: default, lowest, highest, meaning."""

WHOLE_NUMBERS = {
    "max_in_flight": (16, 1, HISTORY, "demonstrations ahead of what a learner has learned"),
    "start_iteration": (1, 1, 2**31 - 1, "the first demonstration to play; learners get those before it at once"),
    "loop": (1, 0, 2**31 - 1, "how often to play to topics that nobody learns from; 0: without end"),
    "read_ahead": (100, 1, 100_000, "demonstrations of each learner that are read before they are due"),
}

FLAGS = {
    "start_paused": "begin paused",
    "listeners": "play to topics that nobody learns from, too, instead of waiting for learners",
    "stay": "stay after the end, for the services play and seek",
}

TEXTS = {
    "bag": "bag to play; empty: the experiment's",
    "bag_digest": "digest of the demonstrations that it must hold, such as a manifest names; empty: any",
    "baseline": "a central method that learns in the learners' place; empty: none",
}

LISTS = {
    "bags": "several bags to play as one, in the place of bag",
    "include": "learners to play to, by name or regular expression; unset: all",
    "exclude": "learners not to play to, by name or regular expression",
}


def strings(node: Node, name: str) -> list[str]:
    """A parameter of LISTS.

    Parameters
    ----------
    node : Node
        The player.
    name : str
        Of the parameter.

    Returns
    -------
    list[str]
        Empty where it is unset.
    """
    value: Sequence[str] | None = node.get_parameter_or(name, Parameter(name)).value
    return list(value or [])


def bags_of(node: Node, experiment: Experiment) -> list[Path]:
    """The bags that a player plays.

    Parameters
    ----------
    node : Node
        The player.
    experiment : Experiment
        Whose bag it is where none is named.

    Returns
    -------
    list[Path]
        One, or several to be played as one.
    """
    several = strings(node, "bags")
    bag = node.get_parameter("bag").value or experiment.demonstrations.bag
    return [Path(name) for name in several] or [Path(bag)]


def chosen_learners(node: Node, learners: Sequence[str]) -> list[str]:
    """To whom a player plays.

    Parameters
    ----------
    node : Node
        The player.
    learners : Sequence[str]
        Of the experiment.

    Returns
    -------
    list[str]
        Of these learners those that are included, less those that are excluded.

    Raises
    ------
    ExperimentError
        There are none, or a pattern is no regular expression or matches nobody.
    """
    included = _matching(strings(node, "include"), learners, "include") if strings(node, "include") else set(learners)
    excluded = _matching(strings(node, "exclude"), learners, "exclude")
    if chosen := [name for name in learners if name in included - excluded]:
        return chosen
    raise ExperimentError(f"include and exclude leave no learner; expected some of {', '.join(learners)}")


def _matching(patterns: Sequence[str], learners: Sequence[str], what: str) -> set[str]:
    found = set[str]()
    for pattern in patterns:
        try:
            matching = {name for name in learners if re.fullmatch(pattern, name)}
        except re.error as error:
            raise ExperimentError(f"{what} {pattern!r}: is no regular expression ({error})") from None
        if not matching:
            raise ExperimentError(f"{what} {pattern!r}: matches none of {', '.join(learners)}")
        found |= matching
    return found


def part_of(node: Node, recording: Recording, learners: Sequence[str]) -> Part:
    """Which part of a recording the parameters name.

    Parameters
    ----------
    node : Node
        The player.
    recording : Recording
        What there is.
    learners : Sequence[str]
        To whom it plays.

    Returns
    -------
    Part
        From start_offset and start_iteration on, until the earlier of the two limits.
    """
    value: Any = {name: node.get_parameter(name).value for name in (*NUMBERS, *WHOLE_NUMBERS)}
    beginning = min(recording.time(learner, 1) for learner in learners)
    start = beginning + round(value["start_offset"] * NANOSECONDS)
    ends = [
        origin + round(limit * NANOSECONDS)
        for origin, limit in ((start, value["playback_duration"]), (beginning, value["playback_until"]))
        if limit > 0
    ]
    first = Part().start if value["start_offset"] == 0 else start
    return Part(first, min(ends, default=Part().end), value["start_iteration"])


def is_partial(node: Node) -> bool:
    """Do the parameters ask for less than all that the learners want to learn?"""
    return any(node.get_parameter(name).value > 0 for name in ("playback_duration", "playback_until"))


def gap_limit(node: Node) -> float:
    """Recorded seconds that are waited out at most."""
    return node.get_parameter("max_gap").value or ENDLESS
