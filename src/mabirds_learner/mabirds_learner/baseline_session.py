"""A central method without ROS: update n can be made once every stream's demonstration of iteration n is there."""

from collections.abc import Sequence

from mabirds_core.algorithm.memory import stacked
from mabirds_core.baselines.interface import CentralMethod, CentralState
from mabirds_core.games.interface import Trajectories
from mabirds_learner.inbox import check_iteration
from mabirds_learner.progress import SessionState


class BaselineSession(SessionState):
    """One method's side.

    Parameters
    ----------
    method : CentralMethod
        With its settings.
    streams : Sequence[str]
        Names of the learners whose demonstrations it pools.
    iterations : int
        Updates to make.
    history : int
        How many iterations ahead demonstrations are kept.
    """

    def __init__(self, method: CentralMethod, streams: Sequence[str], iterations: int, history: int) -> None:
        self.method = method
        self._state = method.initial_state()
        self.mixed_from: list[str] = []
        self.last, self._history = iterations, history
        self._demonstrations: dict[str, dict[int, Trajectories]] = {name: {} for name in streams}

    @property
    def state(self) -> CentralState:
        """The method's state before update n."""
        return self._state

    @property
    def backlog(self) -> int:
        """Demonstrations that arrived and are not learned yet, of all streams."""
        return sum(map(len, self._demonstrations.values()))

    @property
    def lag(self) -> int:
        """How far others are ahead: 0, as nobody else learns."""
        return 0

    def waiting_for(self) -> list[str]:
        """Streams whose demonstration of iteration n is still to come."""
        if self.finished:
            return []
        return [name for name, received in self._demonstrations.items() if self.iteration not in received]

    @property
    def missing_demonstration(self) -> bool:
        """Is a demonstration of iteration n still to come?"""
        return bool(self.waiting_for())

    @property
    def ready(self) -> bool:
        """Can the next update be made?"""
        return not (self.finished or self.waiting_for())

    @property
    def can_prepare(self) -> bool:
        """No: all of an update needs all demonstrations."""
        return False

    def prepare(self) -> None:
        """Nothing."""

    def receive_demonstration(self, stream: str, iteration: int, trajectory: Trajectories) -> None:
        """Keep a demonstration.

        Parameters
        ----------
        stream : str
            Of which learner.
        iteration : int
            n.
        trajectory : Trajectories
            zeta(n).

        Raises
        ------
        RefusedMessageError
            It is old, known, or too far ahead.
        """
        ahead = min(self._history, self.last + 1 - self.iteration)
        check_iteration(iteration, self.iteration, self._demonstrations[stream], ahead, trajectory)
        self._demonstrations[stream][iteration] = trajectory

    def step(self) -> dict[str, float]:
        """Make update n; returns the work done since the beginning."""
        n = self.iteration
        pooled = stacked([received.pop(n) for received in self._demonstrations.values()])
        self._state = self.method.update(self._state, pooled)
        return {name: float(count) for name, count in self.state.work._asdict().items()}
