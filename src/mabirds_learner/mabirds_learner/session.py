"""Strict mode without ROS: what has arrived, what is missing, and the next update once nothing is.

Iteration numbers decide, never the order of arrival. A learner at iteration n needs its demonstration zeta(n) and
theta(n), omega(n) of every in-neighbour of E(n); it waits for as long as one is missing.
"""

from collections import defaultdict
from collections.abc import Mapping

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.storage import from_arrays, to_arrays
from mabirds_core.arrays import Array
from mabirds_core.consensus.schedule import EdgeSchedule, smallest_window
from mabirds_core.errors import ScheduleError
from mabirds_core.metrics.metrics import norms
from mabirds_learner.inbox import accept
from mabirds_learner.learner_session import LearnerSession


class StrictSession(LearnerSession):
    """One learner's side of the strict exchange.

    Raises ScheduleError where the schedule lets neighbours run further ahead than ``parameter_history``.
    """

    def __init__(
        self,
        learner: Learner,
        iterations: int,
        demonstration_history: int,
        parameter_history: int,
        closing_rounds: int = 0,
    ) -> None:
        super().__init__(learner, iterations, demonstration_history, parameter_history, closing_rounds)
        self.state: LearnerState = learner.initial_state()
        self._parameters: defaultdict[int, dict[int, Parameters]] = defaultdict(dict)
        self._own[self.iteration] = self.parameters
        self._require_history()

    def _require_history(self) -> None:
        lead = longest_lead(self.learner.schedule)
        if self._parameter_history <= lead:
            raise ScheduleError(
                f"parameter_history {self._parameter_history}: with this schedule a neighbour may be {lead}"
                f" iterations ahead; set at least {lead + 1}"
            )

    @property
    def lag(self) -> int:
        """How many iterations a neighbour is known to be ahead."""
        return max((n - self.iteration for known in self._parameters.values() for n in known), default=0)

    def missing_neighbours(self) -> list[str]:
        """In-neighbours of E(n) whose parameters of iteration n are still to come."""
        if self.finished:
            return []
        missing = [u for u in self._scheduled(self.iteration) if self.iteration not in self._parameters[u]]
        return [self.learner.schedule.learners[u] for u in missing]

    def _scheduled(self, iteration: int) -> list[int]:
        return self.learner.schedule.in_neighbours(self.learner.index, iteration)

    def receive_parameters(self, neighbour: int, iteration: int, parameters: Parameters) -> None:
        """Keep a neighbour's theta, omega of an iteration at which its edge is open; others are of no use.

        Raises RefusedMessageError where they are old, known, or too far ahead.
        """
        if iteration >= 1 and neighbour not in self._scheduled(iteration):
            return
        accept(iteration, self.iteration, self._parameters[neighbour], self._parameter_history, parameters)
        self._parameters[neighbour][iteration] = parameters

    def step(self) -> dict[str, float]:
        """Make update n, only when ``ready``; returns the norms of its gradients, nothing for a closing round."""
        n, metrics = self.iteration, dict[str, float]()
        neighbours = {u: self._parameters[u][n] for u in self._scheduled(n)}
        if n > self._iterations:
            self.state = self.learner.agree(self.state, neighbours)
        else:
            update = self.learner.update(self.state, self._demonstrations[n], neighbours)
            self.state = update.state
            metrics = {f"gradient_{name}": value for name, value in norms(update.gradient).items()}
        self.mixed_from = [self.learner.schedule.learners[u] for u in neighbours]
        for known in self._parameters.values():
            known.pop(n, None)
        self._close_iteration(n)
        return metrics

    def _state_arrays(self) -> dict[str, Array]:
        return to_arrays(self.learner, self.state)

    def _restore(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        self.state = from_arrays(self.learner, iteration, arrays)


def longest_lead(schedule: EdgeSchedule) -> int:
    """How far a learner can be ahead of another: a stalled one stops a second within B iterations, and so on."""
    return smallest_window(schedule) * (len(schedule.learners) - 1)


def default_history(schedule: EdgeSchedule) -> int:
    """Iterations of parameters to keep: 256, or what the schedule needs."""
    return max(256, longest_lead(schedule) + 1)
