"""Strict mixing, the paper's iteration: parameters of every scheduled neighbour, and weights that never change."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array
from mabirds_core.consensus.mixer import LocalStep
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import ScheduleError
from mabirds_core.settings import Settings


class StrictState(NamedTuple):
    """What a strict mixer knows at iteration n.

    Attributes
    ----------
    parameters : Parameters
        theta(n), omega(n).
    received : Mapping[str, Parameters] or None
        Those of the in-neighbours of E(n), by name; None before they came.
    """

    parameters: Parameters
    received: Mapping[str, Parameters] | None = None


@dataclass(frozen=True)
class StrictMixer:
    """(theta, omega) <- sum_u W(n)[v, u] (theta_u, omega_u) for learner v, ``name``, and then its local step."""

    name: str
    schedule: EdgeSchedule

    @property
    def _index(self) -> int:
        return self.schedule.learners.index(self.name)

    def initial(self, parameters: Parameters) -> StrictState:
        """theta(1), omega(1)."""
        return StrictState(parameters)

    def outgoing(self, state: StrictState, iteration: int) -> dict[str, Parameters]:
        """theta(n), omega(n) to every out-neighbour of E(n)."""
        return dict.fromkeys(self.schedule.receivers_of(self.name, iteration), state.parameters)

    def incoming(self, state: StrictState, iteration: int, messages: Mapping[str, Parameters]) -> StrictState:
        """Take the parameters of exactly the in-neighbours of E(n).

        Raises
        ------
        ScheduleError
            Parameters of one are missing, or there are others.
        """
        expected = self.schedule.senders_to(self.name, iteration)
        if sorted(messages) != sorted(expected):
            raise ScheduleError(
                f"iteration {iteration}: parameters of learners {sorted(messages)}, expected {sorted(expected)}"
            )
        return StrictState(state.parameters, messages)

    def mix(self, state: StrictState, iteration: int, local_step: LocalStep | None) -> StrictState:
        """The weighted sum, then the local step from there.

        What is left of the learners' last steps of their own fades in closing rounds; on a complete graph one round
        ends in agreement.
        """
        mixed = self._weighted_sum(state, iteration)
        return StrictState(local_step(mixed) if local_step else mixed)

    def _weighted_sum(self, state: StrictState, iteration: int) -> Parameters:
        """Summed in the order of the list of learners, so that every process rounds alike."""
        row = self.schedule.weights(iteration)[self._index].tolist()
        available = {**(state.received or {}), self.name: state.parameters}
        theta, omega = (np.zeros(values.shape) for values in state.parameters)
        for weight, learner in zip(row, self.schedule.learners, strict=True):
            if learner in available:
                theta += weight * available[learner].theta
                omega += weight * available[learner].omega
        return Parameters(theta, omega)

    def to_arrays(self, state: StrictState) -> dict[str, Array]:  # noqa: ARG002 - all of it is parameters
        """No arrays: theta(n) and omega(n) are all there is to keep."""
        return {}

    def from_arrays(
        self,
        parameters: Parameters,
        arrays: Mapping[str, Array],  # noqa: ARG002 - all of it is parameters
    ) -> StrictState:
        """theta(n) and omega(n)."""
        return StrictState(parameters)


class StrictMixing(Settings):
    """The paper's iteration: every scheduled neighbour is waited for, however long."""

    kind: Literal["strict"] = "strict"

    @property
    def declares_members(self) -> bool:
        """Can the network go on without a learner? Never: it is waited for."""
        return False

    def mixer(self, name: str, schedule: EdgeSchedule) -> StrictMixer:
        """The mixer of a learner.

        Parameters
        ----------
        name : str
            Of the learner.
        schedule : EdgeSchedule
            E(n) and W(n).

        Returns
        -------
        StrictMixer
            There is nothing to set.
        """
        return StrictMixer(name, schedule)
