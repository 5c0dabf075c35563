"""Algorithm 1 with push-sum in place of mixing, for networks that lose messages or learners.

Learner v at iteration n, with theta, omega = s / y:
  1. gives its out-neighbours of E(n) their shares,
  2. takes what has arrived of iteration n and earlier from its in-neighbours,
  3. s <- s - (beta(n) grad_theta, alpha(n) grad_omega), the gradient at theta, omega as in strict mode.

While nothing is lost, y = 1 and this is the paper's iteration. With loss every gradient still enters the total
mass once and fully, so that the network descends the sum of all learners' losses; keeping a silent neighbour's
weight for oneself would weigh the learners unevenly instead. The paper's theorem does not cover loss.

Small y: a step on s moves s / y by 1 / y as much. A learner whose weight is below ``smallest_weight``, since its
in-neighbours' messages are missing, gives nothing away and keeps its estimate until it has more.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.consensus.push_sum import Ledger, RunningSum, opening
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.games.interface import Trajectories


class ResilientState(NamedTuple):
    """A learner before its update n, its shares of iteration n already given."""

    learner: LearnerState
    ledger: Ledger

    @property
    def iteration(self) -> int:
        """n."""
        return self.learner.iteration

    @property
    def parameters(self) -> Parameters:
        """theta(n), omega(n): the estimate."""
        return self.learner.parameters


class ResilientUpdate(NamedTuple):
    """The state of iteration n + 1 and the gradient of G that led there."""

    state: ResilientState
    gradient: Parameters


@dataclass(frozen=True)
class ResilientLearner:
    """Learner ``name`` among the members of ``schedule``, which may be fewer than those of the experiment."""

    learner: Learner
    name: str
    schedule: EdgeSchedule
    smallest_weight: float

    def begin(self, state: LearnerState, weight: float = 1.0) -> ResilientState:
        """Enter the network with the estimate of ``state``; ``weight`` 0: as a newcomer without mass."""
        return self._gave(ResilientState(state, opening(state.parameters, weight)))

    def joined(self, state: ResilientState, iteration: int, sums: Mapping[str, RunningSum]) -> ResilientState | None:
        """A newcomer with what it was given until ``iteration``, which it starts at; None while that is too little."""
        ledger = taken(state.ledger, sums)
        if ledger.weight < self.smallest_weight:
            return None
        return self._gave(
            ResilientState(
                state.learner._replace(iteration=iteration, parameters=self._estimate(ledger, state)), ledger
            )
        )

    def update(
        self, state: ResilientState, demonstration: Trajectories, sums: Mapping[str, RunningSum]
    ) -> ResilientUpdate:
        """One iteration. ``sums``: the newest running sum, of iteration n or earlier, by the name of its sender."""
        lesson = self.learner.learn(state.learner, demonstration)
        n, origin = state.iteration, Parameters(*(0.0 * values for values in lesson.gradient))
        ledger = taken(state.ledger, sums).moved(self.learner.steps.descend(origin, lesson.gradient, n))
        after = LearnerState(n + 1, self._estimate(ledger, state), lesson.recent, lesson.policy)
        return ResilientUpdate(self._gave(ResilientState(after, ledger)), lesson.gradient)

    def agree(self, state: ResilientState, sums: Mapping[str, RunningSum]) -> ResilientState:
        """A closing round: an iteration without a step."""
        ledger = taken(state.ledger, sums)
        after = state.learner._replace(iteration=state.iteration + 1, parameters=self._estimate(ledger, state))
        return self._gave(ResilientState(after, ledger))

    def _estimate(self, ledger: Ledger, before: ResilientState) -> Parameters:
        known = before.parameters
        return ledger.estimate(known.theta.size) if ledger.weight >= self.smallest_weight else known

    def _gave(self, state: ResilientState) -> ResilientState:
        """The state after giving the out-neighbours of E(n) their shares."""
        if state.ledger.weight < self.smallest_weight:
            return state
        n, v = state.iteration, self.schedule.learners.index(self.name)
        column = self.schedule.weights(n)[:, v]
        receivers = [receiver for sender, receiver in self.schedule.edges(n) if sender == v]
        shares = {self.schedule.learners[u]: float(column[u]) for u in sorted(receivers)}
        return state._replace(ledger=state.ledger.give(shares, float(column[v])))


def taken(ledger: Ledger, sums: Mapping[str, RunningSum]) -> Ledger:
    """The ledger with all that has arrived, added in the order of the senders' names."""
    for name, total in sorted(sums.items()):
        ledger = ledger.take(name, total)
    return ledger
