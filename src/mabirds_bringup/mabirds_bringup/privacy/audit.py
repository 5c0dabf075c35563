"""How much of private demonstrations the parameters of a recorded run reveal, learner by learner."""

from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np

from mabirds_bringup.privacy.attack import Rebuilt, rebuild
from mabirds_core.arrays import Indices
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Streams


class Revealed(NamedTuple):
    """What was rebuilt of a learner's demonstrations.

    ``demonstrations``: how many there were. ``whole``: how many were rebuilt in every step. ``steps``: share of the
    steps rebuilt, of those until all experts rest, since the rest tells itself.
    """

    demonstrations: int
    whole: int
    steps: float


def audit(
    experiment: Experiment,
    history: History,
    demonstrations: Streams,
    on_learner: Callable[[str], None] = lambda _: None,
) -> Mapping[str, Revealed]:
    """Attack every learner of a run, and compare with what it was really shown.

    ``history``: whole. ``demonstrations``: of the run. ``on_learner``: called before each. Raises ExperimentError where
    the attack is none.
    """
    found = dict[str, Revealed]()
    for name in experiment.learners:
        on_learner(name)
        shown = [trajectory.states[0] for trajectory in demonstrations[name][: experiment.iterations]]
        found[name] = compared(rebuild(experiment, name, history), shown)
    return found


def compared(rebuilt: Rebuilt, shown: list[Indices]) -> Revealed:
    """Rebuilt joint states against those that were shown."""
    right = total = whole = 0
    for guess, truth in zip(rebuilt, shown, strict=True):
        length = _until_rest(truth)
        hits = 0 if guess is None else int((guess[:length] == truth[:length]).sum())
        right, total, whole = right + hits, total + length, whole + (hits == length)
    return Revealed(len(shown), whole, right / total)


def _until_rest(states: Indices) -> int:
    """Steps until the last change of the joint state."""
    changes = np.flatnonzero(np.diff(states))
    return int(changes[-1]) + 2 if changes.size else 1
