"""Resilient mode without ROS: what neighbours gave, who takes part, and the next update.

A learner at iteration n needs its demonstration zeta(n). It waits a while for the running sums of iteration n of its
in-neighbours of E(n), and goes on without those that are late: what they gave is in their next sums.

Who takes part is declared. An epoch begins with each declaration: the schedule is that of the members, and ledgers are
opened anew from the present estimates, since what a departed member still held cannot be had. A newcomer enters
without mass, and takes its first estimate and its iteration from what its neighbours give.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from mabirds_core.algorithm.storage import from_arrays, ledger_arrays, ledger_from, to_arrays
from mabirds_core.arrays import Array
from mabirds_core.consensus.membership import among
from mabirds_core.consensus.push_sum import RunningSum
from mabirds_core.consensus.resilient import ResilientLearner, ResilientState
from mabirds_core.errors import RefusedMessageError, ScheduleError
from mabirds_core.metrics.metrics import norms
from mabirds_learner.learner_session import LearnerSession

FIRST_EPOCH = 1
"""The epoch of the experiment's own list of learners."""

EPOCHS_AHEAD = 16
"""How many declarations others may know of before this learner hears of them."""

MEMBERSHIP = "membership"
"""What a learner waits for that is no member yet."""

Inbox = defaultdict[str, dict[int, RunningSum]]
"""Running sums that were not taken yet, by sender and iteration."""


class ResilientSession(LearnerSession):
    """One learner's side of the resilient exchange. ``newcomer``: it takes part once a declaration names it."""

    state: ResilientState

    def __init__(
        self,
        learner: ResilientLearner,
        iterations: int,
        demonstration_history: int,
        parameter_history: int,
        closing_rounds: int = 0,
        *,
        newcomer: bool = False,
    ) -> None:
        super().__init__(learner.learner, iterations, demonstration_history, parameter_history, closing_rounds)
        self._method, self._founding_schedule = learner, learner.schedule
        self.epoch, self.members = (0, ()) if newcomer else (FIRST_EPOCH, learner.schedule.learners)
        self.joining = newcomer
        self._brought = 0.0 if newcomer else 1.0
        self.state = learner.begin(learner.learner.initial_state(), self._brought)
        self._inboxes: defaultdict[int, Inbox] = defaultdict(lambda: defaultdict(dict))
        self._taken_at: dict[str, int] = {}
        self._not_waited_for: tuple[int, int] = (0, 0)
        self._gone: set[str] = set()
        self._own[self.iteration] = self.parameters

    @property
    def is_member(self) -> bool:
        """Does this learner take part?"""
        return self._method.name in self.members

    @property
    def finished(self) -> bool:
        """Are all updates made, or has this learner departed?"""
        return super().finished or (self.epoch > 0 and not self.is_member)

    @property
    def lag(self) -> int:
        """How many iterations a neighbour is known to be ahead."""
        return max((max(0, n - self.iteration) for known in self._inbox.values() for n in known), default=0)

    def missing_neighbours(self) -> list[str]:
        """In-neighbours of E(n) of whom nothing of iteration n has come, unless they are waited for no longer."""
        if self.finished or self._not_waited_for == (self.epoch, self.iteration):
            return []
        if not self.is_member:
            return [MEMBERSHIP]
        if self.joining:
            return [name for name in self.members if name != self._method.name]
        heard = {name: max(self._inbox[name], default=0) for name in self._neighbours(0)}
        return [name for name, newest in heard.items() if newest < self.iteration and name not in self._gone]

    @property
    def _inbox(self) -> Inbox:
        return self._inboxes[self.epoch]

    def _neighbours(self, side: int) -> list[str]:
        """In-neighbours (``side`` 0) or out-neighbours (1) of E(n)."""
        schedule = self._method.schedule
        own = schedule.learners.index(self._method.name)
        return [
            schedule.learners[edge[side]] for edge in sorted(schedule.edges(self.iteration)) if edge[1 - side] == own
        ]

    def stop_waiting(self) -> None:
        """Make update n without the neighbours that are late."""
        if self.is_member and not self.joining:
            self._not_waited_for = (self.epoch, self.iteration)

    def set_gone(self, name: str, *, gone: bool) -> None:
        """Wait for ``name`` no longer, or again."""
        (self._gone.add if gone else self._gone.discard)(name)

    def given(self) -> dict[str, RunningSum]:
        """All that was given in this epoch, by those who are to hear of it now."""
        if self.finished or self.joining or not self.is_member:
            return {}
        nothing = RunningSum.zero(self.state.ledger.own.size)
        return {name: self.state.ledger.given.get(name, nothing) for name in self._neighbours(1)}

    def receive_sum(self, sender: str, epoch: int, iteration: int, total: RunningSum) -> None:
        """Keep what ``sender`` has given up to an iteration of this epoch, or of one that is not declared here yet.

        Raises RefusedMessageError where it is of an earlier epoch, contained in what is known, or out of all reach.
        """
        self._require_news(sender, epoch, iteration)
        known = self._inboxes[epoch][sender]
        known[iteration] = total
        while len(known) > self._parameter_history:
            del known[min(known)]  # contained in later ones
        if self.joining and epoch == self.epoch:
            self._join()

    def _require_news(self, sender: str, epoch: int, iteration: int) -> None:
        if not self.epoch <= epoch <= self.epoch + EPOCHS_AHEAD:
            reason = "old_epoch" if epoch < self.epoch else "future_epoch"
            raise RefusedMessageError(reason, f"epoch {epoch}, expected {self.epoch} to {self.epoch + EPOCHS_AHEAD}")
        if iteration > self.last:
            raise RefusedMessageError("future_iteration", f"iteration {iteration}, expected at most {self.last}")
        if iteration in self._inboxes[epoch][sender]:
            raise RefusedMessageError("duplicate", f"iteration {iteration} has arrived before")
        taken = self._taken_at.get(sender, 0) if epoch == self.epoch else 0
        if iteration <= taken:
            raise RefusedMessageError("old_iteration", f"iteration {iteration}, expected more than {taken}, taken last")

    def _join(self) -> None:
        """Begin, if what neighbours have given is enough."""
        iteration = max(n for known in self._inbox.values() for n in known)
        state = self._method.joined(self.state, iteration, self._newest(iteration))
        if state is not None:
            self._take(iteration)
            self.state, self.joining = state, False
            self._close_iteration(iteration - 1)

    def _newest(self, until: int) -> dict[str, RunningSum]:
        """By sender the newest sum of an iteration up to ``until``."""
        fitting = {name: max((n for n in known if n <= until), default=0) for name, known in self._inbox.items()}
        return {name: self._inbox[name][n] for name, n in fitting.items() if n > 0}

    def _take(self, until: int) -> None:
        """Note what was taken, and drop what is contained in it."""
        for name, known in self._inbox.items():
            for n in [n for n in known if n <= until]:
                self._taken_at[name] = max(n, self._taken_at.get(name, 0))
                del known[n]

    def follow(self, epoch: int, members: Sequence[str]) -> None:
        """Begin an epoch; raises RefusedMessageError where it is not new, or its members cannot learn together."""
        if epoch < self.epoch or (epoch == self.epoch and set(members) == set(self.members)):
            raise RefusedMessageError("old_epoch", f"epoch {epoch}, expected more than {self.epoch}")
        if epoch > self.epoch + EPOCHS_AHEAD:
            raise RefusedMessageError("future_epoch", f"epoch {epoch}, expected at most {self.epoch + EPOCHS_AHEAD}")
        if epoch == self.epoch:
            raise RefusedMessageError("conflict", f"epoch {epoch} has begun with other members, {list(self.members)}")
        try:
            schedule = among(self._founding_schedule, members)
        except ScheduleError as error:
            raise RefusedMessageError("impossible_schedule", f"epoch {epoch}: {error}") from None
        self.joining = not self.is_member
        self.epoch, self.members, self._taken_at = epoch, schedule.learners, {}
        for earlier in [known for known in self._inboxes if known < epoch]:
            del self._inboxes[earlier]
        if self.is_member:
            self._method = replace(self._method, schedule=schedule)
            self._brought = 0.0 if self.joining else 1.0
            self.state = self._method.begin(self.state.learner, self._brought)
            if self.joining and any(self._inbox.values()):
                self._join()

    def step(self) -> dict[str, float]:
        """Make update n, only when ``ready``; returns ``weights`` and the norms of its gradients."""
        n, metrics = self.iteration, dict[str, float]()
        sums = self._newest(n)
        if n > self._iterations:
            self.state = self._method.agree(self.state, sums)
        else:
            update = self._method.update(self.state, self._demonstrations[n], sums)
            self.state = update.state
            metrics = {f"gradient_{name}": value for name, value in norms(update.gradient).items()}
        self.mixed_from = sorted(sums)
        self._take(n)
        self._close_iteration(n)
        return {**metrics, **self.weights()}

    def weights(self) -> dict[str, float]:
        """The weight held and brought into this epoch, and by neighbour given and taken: shows whether mass is lost."""
        ledger = self.state.ledger
        given = {f"weight_given.{name}": float(one.total[-1]) for name, one in ledger.given.items()}
        taken = {f"weight_taken.{name}": float(one.total[-1]) for name, one in ledger.taken.items()}
        return {"weight": ledger.weight, "weight_brought": self._brought, **given, **taken}

    def _state_arrays(self) -> dict[str, Array]:
        taken_at = [(self.learner.schedule.learners.index(name), n) for name, n in self._taken_at.items()]
        return {
            **to_arrays(self.learner, self.state.learner),
            **ledger_arrays(self.state.ledger),
            "taken_at": np.array(taken_at, dtype=np.float64).reshape(-1, 2),
            "epoch": np.array([self.epoch, float(self.joining), self._brought]),
            "members": self._indices(list(self.members)),
        }

    def _restore(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        size = self.state.ledger.own.size
        self.state = ResilientState(from_arrays(self.learner, iteration, arrays), ledger_from(arrays, size))
        epoch, joining, self._brought = arrays["epoch"].tolist()
        self.epoch, self.joining = int(epoch), bool(joining)
        self.members = tuple(self._names(arrays["members"]))
        self._taken_at = {self.learner.schedule.learners[int(u)]: int(n) for u, n in arrays["taken_at"]}
        if self.is_member:
            self._method = replace(self._method, schedule=among(self._founding_schedule, self.members))
