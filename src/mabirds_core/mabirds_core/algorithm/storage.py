"""A learner's state as named arrays, which is what checkpoints hold, and back.

Everything that decides the iterations to come is in it: theta, omega, what its mixer knows besides, the demonstrations
of the window, and what the planner wants to remember. Generators are not: each iteration makes its own from
(seed, learner, iteration).
"""

from collections.abc import Mapping

import numpy as np

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.parameters import MAX_PARAMETER, Parameters
from mabirds_core.algorithm.steps import RuleState
from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError

POLICY, RULE = "policy.", "steps."
"""Prefixes of the arrays that the planner and the step rule remember."""


def to_arrays(learner: Learner, state: LearnerState) -> dict[str, Array]:
    """The state without its iteration number.

    Parameters
    ----------
    learner : Learner
        Whose state it is.
    state : LearnerState
        Before update n.

    Returns
    -------
    dict[str, Array]
        theta, omega, steps.NAME, policy.NAME, the mixer's and the memory's.
    """
    parameters = {"theta": state.parameters.theta, "omega": state.parameters.omega}
    arrays = {**parameters, **learner.mixer.to_arrays(state.mixing)}
    arrays |= state.memory.to_arrays()
    arrays |= {f"{RULE}{name}": values for name, values in state.rule.items()}
    if state.policy is not None:
        planned = learner.estimator.planner.state_dict(state.policy)
        arrays |= {f"{POLICY}{name}": values for name, values in planned.items()}
    return arrays


def from_arrays(learner: Learner, iteration: int, arrays: Mapping[str, Array]) -> LearnerState:
    """The state that ``to_arrays`` was given, as far as later iterations are concerned.

    Parameters
    ----------
    learner : Learner
        Whose state it is.
    iteration : int
        n.
    arrays : Mapping[str, Array]
        By name.

    Returns
    -------
    LearnerState
        Before update n.

    Raises
    ------
    MabirdsError
        The arrays do not fit the learner's game and settings.
    """
    parameters, planned = parameters_of(learner, arrays), _of(POLICY, arrays)
    policy = learner.estimator.planner.load_state_dict(planned) if planned else None
    mixing = learner.mixer.from_arrays(parameters, arrays)
    return LearnerState(iteration, mixing, learner.memory.from_arrays(arrays), _rule_of(learner, arrays), policy)


def _of(prefix: str, arrays: Mapping[str, Array]) -> dict[str, Array]:
    return {name.removeprefix(prefix): values for name, values in arrays.items() if name.startswith(prefix)}


def _rule_of(learner: Learner, arrays: Mapping[str, Array]) -> RuleState:
    """What the step rule remembered; raises CheckpointError where it is of another rule or no finite number."""
    like = learner.steps.initial(learner.estimator.initial_parameters(learner.seed))
    rule = _of(RULE, arrays)
    if {name: values.shape for name, values in rule.items()} != {name: values.shape for name, values in like.items()}:
        raise CheckpointError(f"steps: expected arrays {sorted(like)} of the step rule, found {sorted(rule)}")
    if not all(np.isfinite(values).all() for values in rule.values()):
        raise CheckpointError("steps: expected finite numbers")
    return rule


def parameters_of(learner: Learner, arrays: Mapping[str, Array]) -> Parameters:
    """theta and omega of a checkpoint.

    Parameters
    ----------
    learner : Learner
        Whose they are.
    arrays : Mapping[str, Array]
        By name.

    Returns
    -------
    parameters : Parameters
        Of the learner's shapes.

    Raises
    ------
    CheckpointError
        Wrong shapes, or what is no finite number.
    """
    like = learner.estimator.initial_parameters(learner.seed)
    parameters = Parameters(*(arrays.get(name, np.empty(0)) for name in Parameters._fields))
    for name, values, expected in zip(Parameters._fields, parameters, like, strict=True):
        if values.shape != expected.shape or not (np.abs(values) <= MAX_PARAMETER).all():
            raise CheckpointError(f"{name}: expected {expected.size} numbers of at most {MAX_PARAMETER:g}")
    return parameters
