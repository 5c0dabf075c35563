"""What is tried: settings of an experiment file with the values that they may have."""

import math
from collections.abc import Mapping, Sequence
from itertools import product
from typing import Any, NamedTuple

import yaml

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, checked, without_defaults
from mabirds_core.extras import require

RANGE = ".."
"""Between the ends of a range."""

Changes = Mapping[str, Any]
"""Values by the path of the setting."""


class Tried(NamedTuple):
    """A setting, and what it may be.

    Attributes
    ----------
    path : str
        Levels of the file, with dots between them.
    values : tuple[Any, ...]
        To take one of; the ends of a range.
    is_range : bool
        Any number between the two values, evenly over their logarithms.
    """

    path: str
    values: tuple[Any, ...]
    is_range: bool

    def at(self, share: float) -> Any:
        """The value at a share in [0, 1) of all there are."""
        if not self.is_range:
            return self.values[int(share * len(self.values))]
        low, high = map(math.log, self.values)
        return float(f"{math.exp(low + share * (high - low)):.4g}")


def tried(text: str) -> Tried:
    """What ``--try`` says.

    Parameters
    ----------
    text : str
        PATH=VALUE,VALUE,... or PATH=LOW..HIGH.

    Returns
    -------
    Tried
        Values as YAML has them.

    Raises
    ------
    ExperimentError
        It says something else.

    Examples
    --------
    >>> tried("algorithm.policy.temperature=0.3..3").at(0.5)
    0.9487
    >>> tried("algorithm.window=5,all").values
    (5, 'all')
    """
    path, sign, right = text.partition("=")
    form = f"--try {text}: expected PATH=VALUE,VALUE,... or PATH=LOW..HIGH with numbers above 0"
    if not (path and sign and right):
        raise ExperimentError(form)
    is_range = RANGE in right
    try:
        values = tuple(yaml.safe_load(part) for part in right.split(RANGE if is_range else ","))
    except yaml.YAMLError:
        raise ExperimentError(form) from None
    numbers = [value for value in values if isinstance(value, int | float) and value > 0]
    if is_range and not (len(numbers) == len(values) == 2 and values[0] < values[1]):
        raise ExperimentError(form)
    return Tried(path, values, is_range)


def drawn(settings: Sequence[Tried], trials: int, seed: int) -> list[Changes]:
    """What the trials change; the first changes nothing.

    Parameters
    ----------
    settings : Sequence[Tried]
        At least one.
    trials : int
        How many, at most.
    seed : int
        Of the draw.

    Returns
    -------
    list[Changes]
        All combinations, where there are no ranges and no more of them; else points of a scrambled Halton sequence.
    """
    paths = [of.path for of in settings]
    if not any(of.is_range for of in settings) and math.prod(len(of.values) for of in settings) < trials:
        combinations = product(*(of.values for of in settings))
        return [{}, *(dict(zip(paths, values, strict=True)) for values in combinations)]
    require("scipy", "drawing settings", "mabirds_bringup[bench]")
    from scipy.stats import qmc

    points = qmc.Halton(len(settings), rng=seed).random(trials - 1)
    return [
        {},
        *({of.path: of.at(float(share)) for of, share in zip(settings, point, strict=True)} for point in points),
    ]


def changed(experiment: Experiment, changes: Changes) -> Experiment:
    """The experiment with some settings changed.

    Parameters
    ----------
    experiment : Experiment
        As in its file.
    changes : Changes
        By path.

    Returns
    -------
    Experiment
        Checked.

    Raises
    ------
    ExperimentError
        There is no such setting, it cannot have such a value, or demonstrations would be of another game.
    """
    content = without_defaults(experiment)
    for path, value in changes.items():
        *levels, last = path.split(".")
        place = content
        for level in levels:
            place = place.setdefault(level, {})
            if not isinstance(place, dict):
                raise ExperimentError(f"--try {path}: {level} is no group of settings")
        place[last] = value
    words = ", ".join(f"{path}={value}" for path, value in changes.items())
    result = checked(content, f"--try {words}", experiment.demonstrations.bag.parent)
    if build_game(result).digest != build_game(experiment).digest:
        raise ExperimentError(f"--try {words}: the bag's demonstrations are of another game; import or record anew")
    return result
