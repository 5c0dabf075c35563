"""A learner's state as named arrays, which is what checkpoints hold, and back.

Everything that decides the iterations to come is in it: theta, omega, what its mixer knows besides, the demonstrations
of the window, and what the planner wants to remember. Generators are not: each iteration makes its own from
(seed, learner, iteration).
"""

from collections.abc import Mapping
from itertools import count, takewhile

import numpy as np

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.parameters import LARGEST, Parameters
from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError

MEMORY = "policy."
"""Prefix of the arrays that the planner remembers."""


def to_arrays(learner: Learner, state: LearnerState) -> dict[str, Array]:
    """The state without its iteration number: theta, omega, recent.K.states, recent.K.actions, policy.NAME, mixer's."""
    own = {"theta": state.parameters.theta, "omega": state.parameters.omega}
    arrays = {**own, **learner.mixer.to_arrays(state.mixing)}
    for number, trajectory in enumerate(state.recent):
        arrays |= dict(zip(_names(number), learner.game.encode(trajectory), strict=True))
    if state.policy is not None:
        memory = learner.estimator.planner.state_dict(state.policy)
        arrays |= {f"{MEMORY}{name}": values for name, values in memory.items()}
    return arrays


def from_arrays(learner: Learner, iteration: int, arrays: Mapping[str, Array]) -> LearnerState:
    """The state that ``to_arrays`` was given, as far as later iterations are concerned.

    Raises MabirdsError where the arrays do not fit the learner's game and settings.
    """
    recorded = takewhile(lambda names: set(names) <= arrays.keys(), map(_names, count()))
    recent = tuple(learner.game.decode(*(arrays[name] for name in names)) for names in recorded)
    memory = {name.removeprefix(MEMORY): values for name, values in arrays.items() if name.startswith(MEMORY)}
    policy = learner.estimator.planner.load_state_dict(memory) if memory else None
    mixing = learner.mixer.from_arrays(parameters_of(learner, arrays), arrays)
    return LearnerState(iteration, mixing, recent, policy)


def parameters_of(learner: Learner, arrays: Mapping[str, Array]) -> Parameters:
    """theta and omega; raises CheckpointError for wrong shapes and for what is no finite number."""
    like = learner.estimator.initial_parameters(learner.seed)
    found = Parameters(*(arrays.get(name, np.empty(0)) for name in Parameters._fields))
    for name, values, expected in zip(Parameters._fields, found, like, strict=True):
        if values.shape != expected.shape or not (np.abs(values) <= LARGEST).all():
            raise CheckpointError(f"{name}: expected {expected.size} numbers of at most {LARGEST:g}")
    return found


def _names(number: int) -> tuple[str, str]:
    """Where the demonstration that is ``number`` iterations older than the newest is kept."""
    return f"recent.{number}.states", f"recent.{number}.actions"
