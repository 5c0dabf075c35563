"""Strict mode without ROS: what has arrived, what is missing, and the next update once nothing is.

Iteration numbers decide, never the order of arrival. A learner at iteration n needs its demonstration zeta(n) and
theta(n), omega(n) of every in-neighbour of E(n); it waits for as long as one is missing.
"""

from collections import defaultdict

from mabirds_core.algorithm import Learner, LearnerState
from mabirds_core.errors import ScheduleError
from mabirds_core.games.interface import Trajectories
from mabirds_core.metrics import norms
from mabirds_core.parameters import Parameters
from mabirds_core.schedule import EdgeSchedule, smallest_window
from mabirds_learner.inbox import accept
from mabirds_learner.progress import Standing

DEMONSTRATION = "demonstration"


class StrictSession(Standing):
    """One learner's side of the exchange.

    ``iterations``: updates to make; ``closing_rounds``: rounds of averaging alone after them.
    ``demonstration_history``, ``parameter_history``: how many iterations ahead messages are kept. Raises
    ScheduleError where the schedule lets neighbours run further ahead than that.
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
        self.state: LearnerState = learner.initial_state()
        self.mixed_from: list[str] = []
        self._iterations, self.last = iterations, iterations + closing_rounds
        self._demonstration_history = demonstration_history
        self._parameter_history = parameter_history
        self._demonstrations: dict[int, Trajectories] = {}
        self._parameters: defaultdict[int, dict[int, Parameters]] = defaultdict(dict)
        self._own: dict[int, Parameters] = {self.state.iteration: self.state.parameters}
        self._require_history()

    def _require_history(self) -> None:
        lead = longest_lead(self.learner.schedule)
        if self._parameter_history <= lead:
            raise ScheduleError(
                f"parameter_history {self._parameter_history}: with this schedule a neighbour may be {lead}"
                f" iterations ahead; set at least {lead + 1}"
            )

    @property
    def backlog(self) -> int:
        """Demonstrations that arrived and are not learned yet."""
        return len(self._demonstrations)

    @property
    def missing_demonstration(self) -> bool:
        """Is zeta(n) still to come?"""
        return self.iteration <= self._iterations and self.iteration not in self._demonstrations

    def missing_neighbours(self) -> list[int]:
        """In-neighbours of E(n) whose parameters of iteration n are still to come."""
        if self.finished:
            return []
        return [u for u in self._scheduled(self.iteration) if self.iteration not in self._parameters[u]]

    def _scheduled(self, iteration: int) -> list[int]:
        return self.learner.schedule.in_neighbours(self.learner.index, iteration)

    def waiting_for(self) -> list[str]:
        """Names of what is missing for the next update; empty when it can be made."""
        names = [self.learner.schedule.learners[u] for u in self.missing_neighbours()]
        return ([DEMONSTRATION] if self.missing_demonstration else []) + names

    @property
    def ready(self) -> bool:
        """Can the next update be made?"""
        return not (self.finished or self.missing_demonstration or self.missing_neighbours())

    def receive_demonstration(self, iteration: int, trajectory: Trajectories) -> None:
        """Keep zeta(iteration). Raises RefusedMessageError where it is old, known, or too far ahead."""
        accept(iteration, self.iteration, self._demonstrations, self._demonstration_history)
        self._demonstrations[iteration] = trajectory

    def receive_parameters(self, neighbour: int, iteration: int, parameters: Parameters) -> None:
        """Keep a neighbour's theta, omega of an iteration at which its edge is open; others are of no use.

        Raises RefusedMessageError where they are old, known, or too far ahead.
        """
        if iteration < 1 or neighbour not in self._scheduled(iteration):
            return
        accept(iteration, self.iteration, self._parameters[neighbour], self._parameter_history)
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
        self._forget(n)
        return metrics

    def _forget(self, iteration: int) -> None:
        """Drop what served update n, and own parameters that nobody can ask for any more."""
        self._demonstrations.pop(iteration, None)
        for known in self._parameters.values():
            known.pop(iteration, None)
        self._own[self.iteration] = self.state.parameters
        self._own.pop(self.iteration - self._parameter_history, None)

    @property
    def kept(self) -> tuple[int, int]:
        """Oldest and newest iteration of which own parameters are kept."""
        return min(self._own), max(self._own)

    def own_parameters(self, iteration: int) -> Parameters | None:
        """theta(iteration), omega(iteration) of this learner, for a neighbour that missed them."""
        return self._own.get(iteration)


def longest_lead(schedule: EdgeSchedule) -> int:
    """How far a learner can be ahead of another: a stalled one stops a second within B iterations, and so on."""
    return smallest_window(schedule) * (len(schedule.learners) - 1)


def default_history(schedule: EdgeSchedule) -> int:
    """Iterations of parameters to keep: 64, or what the schedule needs."""
    return max(64, longest_lead(schedule) + 1)
