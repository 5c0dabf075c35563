"""What a node drives: the part of a learner or central method that knows no ROS."""

from abc import ABC, abstractmethod
from typing import TYPE_CHECKING, Protocol

from mabirds_core.algorithm.learner import LearnerState
from mabirds_core.algorithm.parameters import Parameters

if TYPE_CHECKING:
    from mabirds_core.baselines.interface import CentralState


class Session(Protocol):
    """What has arrived, what is missing, and the next update once nothing is."""

    mixed_from: list[str]

    @property
    def epoch(self) -> int:
        """Epoch of the membership that is followed; 0 where there is none."""
        ...

    @property
    def iteration(self) -> int:
        """n: theta(n), omega(n) are the current estimates."""
        ...

    @property
    def parameters(self) -> Parameters:
        """theta(n), omega(n)."""
        ...

    @property
    def finished(self) -> bool:
        """Are all updates made?"""
        ...

    @property
    def backlog(self) -> int:
        """Demonstrations that arrived and are not learned yet."""
        ...

    @property
    def lag(self) -> int:
        """How many iterations others are known to be ahead."""
        ...

    @property
    def missing_demonstration(self) -> bool:
        """Is a demonstration of iteration n still to come?"""
        ...

    @property
    def ready(self) -> bool:
        """Can the next update be made?"""
        ...

    @property
    def can_prepare(self) -> bool:
        """Can the part of the next update that needs nobody else be made?"""
        ...

    def prepare(self) -> None:
        """Make that part, only when ``can_prepare``."""
        ...

    def waiting_for(self) -> list[str]:
        """Names of what is missing for the next update."""
        ...

    def step(self) -> dict[str, float]:
        """Make update n, only when ``ready``; returns what is worth watching about it."""
        ...


class SessionState(ABC):
    """Where a session stands, as its state tells.

    Attributes
    ----------
    last : int
        The iteration after which nothing is left to do.
    """

    last: int

    @property
    @abstractmethod
    def state(self) -> "LearnerState | CentralState":
        """The state before update n."""

    @property
    def epoch(self) -> int:
        """Epoch of the membership that is followed; 0 where there is none, as in strict mode."""
        return 0

    @property
    def iteration(self) -> int:
        """n: theta(n), omega(n) are the current estimates."""
        return self.state.iteration

    @property
    def parameters(self) -> Parameters:
        """theta(n), omega(n)."""
        return self.state.parameters

    @property
    def finished(self) -> bool:
        """Are all updates and closing rounds made?"""
        return self.iteration > self.last
