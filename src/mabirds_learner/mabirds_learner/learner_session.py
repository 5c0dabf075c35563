"""What sessions of both modes share: demonstrations that arrived, own parameters that others may ask for."""

from abc import ABC, abstractmethod
from collections.abc import Mapping

import numpy as np

from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.storage import parameters_of
from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError
from mabirds_core.games.interface import Trajectories
from mabirds_learner.checkpoint import Checkpoints
from mabirds_learner.inbox import accept
from mabirds_learner.progress import Standing

DEMONSTRATION = "demonstration"

MIXED_FROM = "mixed_from"
"""Name of the array of those whose parameters entered the newest update, in a checkpoint."""


class LearnerSession(Standing, ABC):
    """One learner's side of the exchange.

    ``iterations``: updates to make; ``closing_rounds``: rounds of averaging alone after them.
    ``demonstration_history``, ``parameter_history``: how many iterations ahead messages are kept.
    """

    def __init__(
        self,
        learner: Learner,
        iterations: int,
        demonstration_history: int,
        parameter_history: int,
        closing_rounds: int = 0,
    ) -> None:
        self.learner = learner
        self.mixed_from: list[str] = []
        self._iterations, self.last = iterations, iterations + closing_rounds
        self._demonstration_history = demonstration_history
        self._parameter_history = parameter_history
        self._demonstrations: dict[int, Trajectories] = {}
        self._own: dict[int, Parameters] = {}

    @property
    def backlog(self) -> int:
        """Demonstrations that arrived and are not learned yet."""
        return len(self._demonstrations)

    @property
    def missing_demonstration(self) -> bool:
        """Is zeta(n) still to come?"""
        return self.iteration <= self._iterations and self.iteration not in self._demonstrations

    @property
    @abstractmethod
    def lag(self) -> int:
        """How many iterations a neighbour is known to be ahead."""

    @abstractmethod
    def missing_neighbours(self) -> list[str]:
        """In-neighbours of E(n) that the update n waits for."""

    def waiting_for(self) -> list[str]:
        """Names of what is missing for the next update; empty when it can be made."""
        return ([DEMONSTRATION] if self.missing_demonstration else []) + self.missing_neighbours()

    @property
    def ready(self) -> bool:
        """Can the next update be made?"""
        return not (self.finished or self.waiting_for())

    def receive_demonstration(self, iteration: int, trajectory: Trajectories) -> None:
        """Keep zeta(iteration). Raises RefusedMessageError where it is old, known, or too far ahead."""
        ahead = min(self._demonstration_history, self._iterations + 1 - self.iteration)
        accept(iteration, self.iteration, self._demonstrations, ahead, trajectory)
        self._demonstrations[iteration] = trajectory

    @abstractmethod
    def step(self) -> dict[str, float]:
        """Make update n, only when ``ready``; returns the norms of its gradients, nothing for a closing round."""

    def _close_iteration(self, iteration: int) -> None:
        """Drop what served an update, and own parameters that nobody can ask for any more."""
        for known in [n for n in self._demonstrations if n <= iteration]:
            del self._demonstrations[known]
        self._own[self.iteration] = self.parameters
        self._own.pop(self.iteration - self._parameter_history, None)

    def arrays(self) -> dict[str, Array]:
        """What a checkpoint must hold to go on from here."""
        return {**self._state_arrays(), MIXED_FROM: self._indices(self.mixed_from)}

    def resume(self, checkpoints: Checkpoints) -> None:
        """Go on from the newest that is whole; all answer neighbours. Raises MabirdsError where they do not fit."""
        self._own = {n: parameters_of(self.learner, arrays) for n, arrays in sorted(checkpoints.items())}
        whole = [n for n, arrays in checkpoints.items() if MIXED_FROM in arrays]
        if not whole:
            raise CheckpointError("no checkpoint is whole; name another directory, or delete this one to start anew")
        newest = max(whole)
        self._restore(newest, checkpoints[newest])
        self.mixed_from = self._names(checkpoints[newest].get(MIXED_FROM, np.empty(0)))

    @abstractmethod
    def _state_arrays(self) -> dict[str, Array]:
        """The state as named arrays."""

    @abstractmethod
    def _restore(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        """The state from such arrays."""

    def _indices(self, names: list[str]) -> Array:
        return np.array([self.learner.schedule.learners.index(name) for name in names], dtype=np.float64)

    def _names(self, indices: Array) -> list[str]:
        return [self.learner.schedule.learners[int(u)] for u in indices]

    @property
    def kept(self) -> Mapping[int, Parameters]:
        """theta(n), omega(n) of this learner by n, the oldest first, for those who missed them."""
        return self._own
