"""Mixing by push-sum, for networks that lose messages or learners.

Learner v at iteration n, with theta, omega = s / y:
  1. sends its out-neighbours of E(n) their shares of its mass,
  2. receives what has arrived of iteration n and earlier from its in-neighbours,
  3. s <- s - (beta(n) grad_theta, alpha(n) grad_omega), the gradient at theta, omega as in strict mode.

While nothing is lost, y = 1 and this is the paper's iteration. With loss every gradient still enters the total
mass once and fully, so that the network descends the sum of all learners' losses; keeping a silent neighbour's
weight for oneself would weigh the learners unevenly instead. The paper's theorem does not cover loss.

Small y: a step on s moves s / y by 1 / y as much. A learner whose weight is below ``smallest_weight``, since its
in-neighbours' messages are missing, sends nothing and keeps its estimate until it has more.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydantic import Field

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array
from mabirds_core.consensus.mixer import LocalStep
from mabirds_core.consensus.push_sum import PushSumState, RunningSum
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import CheckpointError
from mabirds_core.settings import Settings

MASS, SENT, RECEIVED = "mass", "mass.given.", "mass.taken."
"""Names in checkpoints: what a learner holds, and the prefixes of its running sums by neighbour."""


@dataclass(frozen=True)
class PushSumMixer:
    """Learner v of a network that may lose messages. Its state at n has the shares of iteration n already sent.

    Attributes
    ----------
    name : str
        Of the learner.
    schedule : EdgeSchedule
        E(n) of the members, who may be fewer than the learners of the experiment.
    smallest_weight : float
        y below which it sends nothing and keeps its estimate.
    """

    name: str
    schedule: EdgeSchedule
    smallest_weight: float

    def initial(self, parameters: Parameters, initial_weight: float = 1.0, iteration: int = 1) -> PushSumState:
        """Enter the network.

        Parameters
        ----------
        parameters : Parameters
            The estimate theta, omega.
        initial_weight : float, optional
            y; 0 for a late joiner without mass.
        iteration : int, optional
            The first one, n.

        Returns
        -------
        PushSumState
            The state at n.
        """
        return self._send(PushSumState.init(parameters, initial_weight), iteration)

    def join(self, state: PushSumState, iteration: int, messages: Mapping[str, RunningSum]) -> PushSumState | None:
        """Enter the network late, with the mass that others have sent.

        Parameters
        ----------
        state : PushSumState
            A state without mass.
        iteration : int
            The first one, n.
        messages : Mapping[str, RunningSum]
            Running sums of iterations up to n, by the name of the sender.

        Returns
        -------
        PushSumState or None
            The state at n; None while the mass is too little.
        """
        joined = self.incoming(state, iteration, messages)
        if joined.weight < self.smallest_weight:
            return None
        return self._send(joined.with_estimate(), iteration)

    def outgoing(self, state: PushSumState, iteration: int) -> dict[str, RunningSum]:
        """To every out-neighbour of E(n) all that it was ever sent, sigma; to one that never got a share, nothing."""
        receivers = self.schedule.receivers_of(self.name, iteration)
        return {name: state.sent[name] for name in receivers if name in state.sent}

    def incoming(
        self,
        state: PushSumState,
        iteration: int,  # noqa: ARG002 - older sums are taken as well
        messages: Mapping[str, RunningSum],
    ) -> PushSumState:
        """Take all that has arrived: the newest running sums, of iteration n or earlier, of any of the in-neighbours.

        They are summed in the order of the senders' names.
        """
        for name, total in sorted(messages.items()):
            state = state.receive(name, total)
        return state

    def mix(self, state: PushSumState, iteration: int, local_step: LocalStep | None) -> PushSumState:
        """s <- s + local step, the estimate s / y of it, and the shares of iteration n + 1 sent."""
        if local_step:
            origin = Parameters(*(np.zeros_like(values) for values in state.parameters))
            state = state.add_to_mass(local_step(origin))
        if state.weight >= self.smallest_weight:
            state = state.with_estimate()
        return self._send(state, iteration + 1)

    def _send(self, state: PushSumState, iteration: int) -> PushSumState:
        """The state after the out-neighbours of E(n) were sent their shares, W(n)[u, v] each."""
        receivers, learners = self.schedule.receivers_of(self.name, iteration), self.schedule.learners
        if state.weight < self.smallest_weight or not receivers:
            return state
        column = self.schedule.weights(iteration)[:, learners.index(self.name)]
        outgoing_weights = {name: float(column[learners.index(name)]) for name in receivers}
        return state.send(outgoing_weights, float(column[learners.index(self.name)]))

    def to_arrays(self, state: PushSumState) -> dict[str, Array]:
        """mass, shape (K,); mass.given.NAME and mass.taken.NAME, total and rest, shape (2, K)."""
        sides = ((SENT, state.sent), (RECEIVED, state.received))
        sums = {f"{prefix}{name}": np.stack(total) for prefix, side in sides for name, total in side.items()}
        return {MASS: state.mass, **sums}

    def from_arrays(self, parameters: Parameters, arrays: Mapping[str, Array]) -> PushSumState:
        """Inverse of ``to_arrays``.

        Raises
        ------
        CheckpointError
            Masses do not fit the parameters.
        """
        size = parameters.theta.size + parameters.omega.size + 1
        chosen = {name: values for name, values in arrays.items() if name == MASS or name.startswith((SENT, RECEIVED))}
        for name, values in chosen.items():
            if values.shape != ((size,) if name == MASS else (2, size)) or not np.isfinite(values).all():
                raise CheckpointError(f"{name}: expected finite numbers, {size} in a row")
        sent, received = (_sums(chosen, prefix) for prefix in (SENT, RECEIVED))
        return PushSumState(arrays.get(MASS, np.zeros(size)), sent, received, parameters)


def _sums(arrays: Mapping[str, Array], prefix: str) -> dict[str, RunningSum]:
    """Running sums by neighbour."""
    return {
        name.removeprefix(prefix): RunningSum(*values) for name, values in arrays.items() if name.startswith(prefix)
    }


class ResilientMixing(Settings):
    """Push-sum with running sums: a neighbour that is late is not waited for, and what it sent arrives later."""

    kind: Literal["resilient"]
    patience: float = Field(1.0, gt=0, le=3600, description="seconds for which late neighbours are waited for")
    smallest_weight: float = Field(0.1, gt=0, lt=1, description="a learner with less keeps its mass and its estimate")

    @property
    def declares_members(self) -> bool:
        """Can the network go on without a learner? Yes, once it is declared who its members are."""
        return True

    def mixer(self, name: str, schedule: EdgeSchedule) -> PushSumMixer:
        """The mixer of a learner.

        Parameters
        ----------
        name : str
            Of the learner.
        schedule : EdgeSchedule
            E(n) of the members.

        Returns
        -------
        PushSumMixer
            With the settings' smallest weight.
        """
        return PushSumMixer(name, schedule, self.smallest_weight)
