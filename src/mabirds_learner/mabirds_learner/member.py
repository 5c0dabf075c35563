"""What a session drives: its learner as a member of a network, by strict mixing or by push-sum."""

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple, Protocol

import numpy as np

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.arrays import Array


class Limits(NamedTuple):
    """How long a learner learns, and how much it keeps.

    Attributes
    ----------
    iterations : int
        Updates to make.
    demonstration_history : int
        How many iterations ahead demonstrations are kept.
    parameter_history : int
        How many iterations ahead parameters are kept.
    closing_rounds : int
        Rounds of averaging alone after the updates.
    """

    iterations: int
    demonstration_history: int
    parameter_history: int
    closing_rounds: int = 0

    @property
    def last(self) -> int:
        """The iteration after which nothing is left to do."""
        return self.iterations + self.closing_rounds


class Member(Protocol):
    """A learner among its neighbours: its state, what they have sent, and whom it waits for.

    Attributes
    ----------
    learner : Learner
        With its present mixer.
    state : LearnerState
        Before update n.
    epoch : int
        Of the membership that is followed; 0: there is none.
    on_join : Callable[[], None]
        Called after it has entered a network at an iteration that others had reached.
    """

    learner: Learner
    state: LearnerState
    epoch: int
    on_join: Callable[[], None]

    @property
    def limits(self) -> Limits:
        """How long it learns, and how much it keeps."""
        ...

    @property
    def departed(self) -> bool:
        """Does the network go on without this learner?"""
        ...

    @property
    def lag(self) -> int:
        """How many iterations a neighbour is known to be ahead."""
        ...

    def missing(self) -> list[str]:
        """Names of the neighbours that update n waits for."""
        ...

    def incoming(self) -> dict[str, Any]:
        """What enters update n, by the names of those who sent it."""
        ...

    def close_iteration(self, iteration: int) -> None:
        """Forget what has entered an update."""
        ...

    def metrics(self) -> dict[str, float]:
        """Numbers worth watching, by name."""
        ...

    def arrays(self) -> dict[str, Array]:
        """What a checkpoint must hold besides the state."""
        ...

    def restore(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        """Go on from a checkpoint.

        Parameters
        ----------
        iteration : int
            n.
        arrays : Mapping[str, Array]
            By name.
        """
        ...


def nothing() -> None:
    """The callback of a member that nobody listens to."""


def indices_of(learners: tuple[str, ...], names: list[str]) -> Array:
    """Places of names in the list of learners, as checkpoints hold them.

    Parameters
    ----------
    learners : tuple[str, ...]
        The list.
    names : list[str]
        Some of them.

    Returns
    -------
    Array
        Shape (len(names),).
    """
    return np.array([learners.index(name) for name in names], dtype=np.float64)


def names_at(learners: tuple[str, ...], indices: Array) -> list[str]:
    """Inverse of ``indices_of``.

    Parameters
    ----------
    learners : tuple[str, ...]
        The list.
    indices : Array
        Places in it.

    Returns
    -------
    list[str]
        Names.
    """
    return [learners[int(u)] for u in indices]
