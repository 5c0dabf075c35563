"""Strict mode without ROS: what neighbours have sent, and what is missing.

Iteration numbers decide, never the order of arrival. A learner at iteration n needs theta(n), omega(n) of every
in-neighbour of E(n); it waits for as long as one is missing.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping

from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.storage import from_arrays
from mabirds_core.arrays import Array
from mabirds_core.consensus.assumptions import connectivity_window
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import ScheduleError
from mabirds_learner.inbox import check_iteration
from mabirds_learner.member import Limits, nothing


class StrictMember:
    """One learner's side of the strict exchange.

    Parameters
    ----------
    learner : Learner
        With a strict mixer.
    limits : Limits
        What it keeps.

    Raises
    ------
    ScheduleError
        The schedule lets neighbours run further ahead than ``limits.parameter_history``.
    """

    epoch = 0
    departed = False

    def __init__(self, learner: Learner, limits: Limits) -> None:
        self.learner, self.limits = learner, limits
        self.state = learner.initial_state()
        self.on_join: Callable[[], None] = nothing
        self._parameters: defaultdict[str, dict[int, Parameters]] = defaultdict(dict)
        self._require_history()

    def _require_history(self) -> None:
        lead = longest_lead(self.learner.mixer.schedule)
        if self.limits.parameter_history <= lead:
            raise ScheduleError(
                f"parameter_history {self.limits.parameter_history}: with this schedule a neighbour may be {lead}"
                f" iterations ahead; set at least {lead + 1}"
            )

    @property
    def lag(self) -> int:
        """How many iterations a neighbour is known to be ahead."""
        return max((n - self.state.iteration for received in self._parameters.values() for n in received), default=0)

    def missing(self) -> list[str]:
        """In-neighbours of E(n) whose parameters of iteration n are still to come."""
        n = self.state.iteration
        return [name for name in self._scheduled(n) if n not in self._parameters[name]]

    def _scheduled(self, iteration: int) -> list[str]:
        mixer = self.learner.mixer
        return mixer.schedule.senders_to(mixer.name, iteration)

    def receive_parameters(self, sender: str, iteration: int, parameters: Parameters) -> None:
        """Keep parameters of an iteration at which the sender's edge is open; others are of no use.

        Parameters
        ----------
        sender : str
            A neighbour.
        iteration : int
            n.
        parameters : Parameters
            theta(n), omega(n) of the neighbour.

        Raises
        ------
        RefusedMessageError
            They are old, known, or too far ahead.
        """
        if iteration >= 1 and sender not in self._scheduled(iteration):
            return
        received = self._parameters[sender]
        check_iteration(iteration, self.state.iteration, received, self.limits.parameter_history, parameters)
        received[iteration] = parameters

    def incoming(self) -> dict[str, Parameters]:
        """theta(n), omega(n) of the in-neighbours of E(n), in the order of the list of learners."""
        n = self.state.iteration
        return {name: self._parameters[name][n] for name in self._scheduled(n)}

    def close_iteration(self, iteration: int) -> None:
        """Forget what has entered an update."""
        for received in self._parameters.values():
            received.pop(iteration, None)

    def metrics(self) -> dict[str, float]:
        """No numbers: parameters show all of them."""
        return {}

    def arrays(self) -> dict[str, Array]:
        """No arrays: neighbours are asked again."""
        return {}

    def restore(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        """Go on from the arrays of a checkpoint."""
        self.state = from_arrays(self.learner, iteration, arrays)


def longest_lead(schedule: EdgeSchedule) -> int:
    """How far a learner can be ahead of another: a stalled one stops a second within B iterations, and so on."""
    return connectivity_window(schedule) * (len(schedule.learners) - 1)


def default_history(schedule: EdgeSchedule) -> int:
    """Iterations of parameters to keep: 256, or what the schedule needs."""
    return max(256, longest_lead(schedule) + 1)
