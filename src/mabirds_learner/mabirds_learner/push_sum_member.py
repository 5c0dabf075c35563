"""Resilient mode without ROS: what neighbours have sent, and who takes part.

A learner at iteration n waits a while for the running sums of iteration n of its in-neighbours of E(n), and goes on
without those that are late: what they sent is in their next sums.

Who takes part is declared. An epoch begins with each declaration: the schedule is that of the members, and push-sum
begins anew from the present estimates, since what a departed member still held cannot be had. A late joiner enters
without mass, and takes its first estimate and its iteration from what its neighbours send.
"""

from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.storage import from_arrays
from mabirds_core.arrays import Array
from mabirds_core.consensus.membership import restrict
from mabirds_core.consensus.push_sum import PushSumState, RunningSum
from mabirds_core.consensus.push_sum_mixer import PushSumMixer
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import ExperimentError, RefusedMessageError, ScheduleError
from mabirds_learner.member import Limits, indices_of, names_at, nothing

FIRST_EPOCH = 1
"""The epoch of the experiment's own list of learners."""

EPOCHS_AHEAD = 16
"""How many declarations others may know of before this learner hears of them."""

MEMBERSHIP = "membership"
"""What a learner waits for that is no member yet."""

Inbox = defaultdict[str, dict[int, RunningSum]]
"""Running sums that did not enter an update yet, by sender and iteration."""


class PushSumMember:
    """One learner's side of the resilient exchange.

    Parameters
    ----------
    learner : Learner
        With a resilient mixer.
    limits : Limits
        What it keeps.
    late_joiner : bool, optional
        It takes part once a declaration names it.

    Raises
    ------
    ExperimentError
        The learner does not mix by push-sum.
    """

    def __init__(self, learner: Learner, limits: Limits, *, late_joiner: bool = False) -> None:
        if not isinstance(learner.mixer, PushSumMixer):
            raise ExperimentError("mixing is strict, expected resilient")
        self.learner, self.limits, self._mixer = learner, limits, learner.mixer
        self._founding_schedule = self._mixer.schedule
        self.epoch, self.members = (0, ()) if late_joiner else (FIRST_EPOCH, self._mixer.schedule.learners)
        self.joining = late_joiner
        self.state = learner.initial_state()
        self._enter(0.0 if late_joiner else 1.0)
        self.on_join: Callable[[], None] = nothing
        self._inboxes: defaultdict[int, Inbox] = defaultdict(lambda: defaultdict(dict))
        self._received_at: dict[str, int] = {}
        self._not_waited_for: tuple[int, int] = (0, 0)
        self._gone: set[str] = set()

    def _enter(self, initial_weight: float) -> None:
        """Begin push-sum at the present iteration and estimate."""
        self._initial_weight = initial_weight
        mixing = self._mixer.initial(self.state.parameters, initial_weight, self.state.iteration)
        self.state = self.state._replace(mixing=mixing)

    @property
    def push_sum(self) -> PushSumState:
        """The masses of the present epoch."""
        return cast("PushSumState", self.state.mixing)

    @property
    def is_member(self) -> bool:
        """Does this learner take part?"""
        return self._mixer.name in self.members

    @property
    def departed(self) -> bool:
        """Has a declaration left this learner out?"""
        return self.epoch > 0 and not self.is_member

    @property
    def lag(self) -> int:
        """How many iterations a neighbour is known to be ahead."""
        return max((max(0, n - self.state.iteration) for masses in self._inbox.values() for n in masses), default=0)

    def missing(self) -> list[str]:
        """In-neighbours of E(n) of whom nothing of iteration n has come, unless they are waited for no longer."""
        n = self.state.iteration
        if self._not_waited_for == (self.epoch, n):
            return []
        if not self.is_member:
            return [MEMBERSHIP]
        if self.joining:
            return [name for name in self.members if name != self._mixer.name]
        senders = self._mixer.schedule.senders_to(self._mixer.name, n)
        return [name for name in senders if max(self._inbox[name], default=0) < n and name not in self._gone]

    @property
    def _inbox(self) -> Inbox:
        return self._inboxes[self.epoch]

    def give_up_waiting(self) -> None:
        """Make update n without the neighbours that are late."""
        if self.is_member and not self.joining:
            self._not_waited_for = (self.epoch, self.state.iteration)

    def set_alive(self, name: str, *, alive: bool) -> None:
        """Wait for a neighbour again, or no longer.

        Parameters
        ----------
        name : str
            Of the neighbour.
        alive : bool
            Its process is back.
        """
        (self._gone.discard if alive else self._gone.add)(name)

    def outgoing(self) -> dict[str, RunningSum]:
        """All that was sent in this epoch, by those who are to hear of it now; a sum of nothing says which n it is."""
        n = self.state.iteration
        if n > self.limits.last or self.joining or not self.is_member:
            return {}
        receivers = self._mixer.schedule.receivers_of(self._mixer.name, n)
        nothing = RunningSum.zero(self.push_sum.mass.size)
        return {**dict.fromkeys(receivers, nothing), **self._mixer.outgoing(self.push_sum, n)}

    def receive_mass(self, sender: str, epoch: int, iteration: int, total: RunningSum) -> None:
        """Keep what a neighbour has sent up to an iteration.

        Parameters
        ----------
        sender : str
            The neighbour.
        epoch : int
            This one, or one that is not declared here yet.
        iteration : int
            n.
        total : RunningSum
            sigma(n).

        Raises
        ------
        RefusedMessageError
            It is of an earlier epoch, contained in what is known, or out of all reach.
        """
        self._require_news(sender, epoch, iteration)
        masses = self._inboxes[epoch][sender]
        masses[iteration] = total
        while len(masses) > self.limits.parameter_history:
            del masses[min(masses)]  # contained in later ones
        if self.joining and epoch == self.epoch:
            self._join()

    def _require_news(self, sender: str, epoch: int, iteration: int) -> None:
        if not self.epoch <= epoch <= self.epoch + EPOCHS_AHEAD:
            reason = "old_epoch" if epoch < self.epoch else "future_epoch"
            raise RefusedMessageError(reason, f"epoch {epoch}, expected {self.epoch} to {self.epoch + EPOCHS_AHEAD}")
        if iteration > self.limits.last:
            raise RefusedMessageError("future_iteration", f"iteration {iteration}, expected at most {self.limits.last}")
        if iteration in self._inboxes[epoch][sender]:
            raise RefusedMessageError("duplicate", f"iteration {iteration} has arrived before")
        taken = self._received_at.get(sender, 0) if epoch == self.epoch else 0
        if iteration <= taken:
            raise RefusedMessageError("old_iteration", f"iteration {iteration}, expected more than {taken}, taken last")

    def _join(self) -> None:
        """Take part, if what neighbours have sent is enough."""
        iteration = max(n for masses in self._inbox.values() for n in masses)
        mixing = self._mixer.join(self.push_sum, iteration, self._newest(iteration))
        if mixing is not None:
            self.close_iteration(iteration)
            self.state, self.joining = self.state._replace(iteration=iteration, mixing=mixing), False
            self.on_join()

    def incoming(self) -> dict[str, RunningSum]:
        """By sender the newest sum of iteration n or earlier, in the order of their names."""
        return dict(sorted(self._newest(self.state.iteration).items()))

    def _newest(self, until: int) -> dict[str, RunningSum]:
        """By sender the newest sum of an iteration up to ``until``."""
        fitting = {name: max((n for n in masses if n <= until), default=0) for name, masses in self._inbox.items()}
        return {name: self._inbox[name][n] for name, n in fitting.items() if n > 0}

    def close_iteration(self, iteration: int) -> None:
        """Note what has entered an update, and forget what is contained in it."""
        for name, masses in self._inbox.items():
            for n in [n for n in masses if n <= iteration]:
                self._received_at[name] = max(n, self._received_at.get(name, 0))
                del masses[n]

    def follow(self, epoch: int, members: Sequence[str]) -> None:
        """Begin an epoch.

        Parameters
        ----------
        epoch : int
            Its number.
        members : Sequence[str]
            Names.

        Raises
        ------
        RefusedMessageError
            It is not new, or its members cannot learn together.
        """
        schedule = self._declared(epoch, members)
        self.joining = not self.is_member
        self.epoch, self.members, self._received_at = epoch, schedule.learners, {}
        for earlier in [kept for kept in self._inboxes if kept < epoch]:
            del self._inboxes[earlier]
        if self.is_member:
            self._use(schedule)
            self._enter(0.0 if self.joining else 1.0)
            if self.joining and any(self._inbox.values()):
                self._join()

    def _declared(self, epoch: int, members: Sequence[str]) -> EdgeSchedule:
        """The schedule of a declaration's members."""
        if epoch < self.epoch or (epoch == self.epoch and set(members) == set(self.members)):
            raise RefusedMessageError("old_epoch", f"epoch {epoch}, expected more than {self.epoch}")
        if epoch > self.epoch + EPOCHS_AHEAD:
            raise RefusedMessageError("future_epoch", f"epoch {epoch}, expected at most {self.epoch + EPOCHS_AHEAD}")
        if epoch == self.epoch:
            raise RefusedMessageError("conflict", f"epoch {epoch} has begun with other members, {list(self.members)}")
        try:
            return restrict(self._founding_schedule, members)
        except ScheduleError as error:
            raise RefusedMessageError("impossible_schedule", f"epoch {epoch}: {error}") from None

    def _use(self, schedule: EdgeSchedule) -> None:
        """Mix along the schedule of the members from now on."""
        self._mixer = replace(self._mixer, schedule=schedule)
        self.learner = replace(self.learner, mixer=self._mixer)

    def metrics(self) -> dict[str, float]:
        """The weight y held and brought into this epoch, and by neighbour sent and received: is any of it lost?"""
        held = self.push_sum
        sent = {f"weight_sent.{name}": float(total.total[-1]) for name, total in held.sent.items()}
        received = {f"weight_received.{name}": float(total.total[-1]) for name, total in held.received.items()}
        return {"weight": held.weight, "initial_weight": self._initial_weight, **sent, **received}

    def arrays(self) -> dict[str, Array]:
        """taken_at, shape (k, 2): a sender and the iteration of its sum received last; epoch; members."""
        learners = self._founding_schedule.learners
        taken_at = [(learners.index(name), n) for name, n in self._received_at.items()]
        return {
            "taken_at": np.array(taken_at, dtype=np.float64).reshape(-1, 2),
            "epoch": np.array([self.epoch, float(self.joining), self._initial_weight]),
            "members": indices_of(learners, list(self.members)),
        }

    def restore(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        """Go on from the arrays of a checkpoint."""
        learners = self._founding_schedule.learners
        self.state = from_arrays(self.learner, iteration, arrays)
        epoch, joining, self._initial_weight = arrays["epoch"].tolist()
        self.epoch, self.joining = int(epoch), bool(joining)
        self.members = tuple(names_at(learners, arrays["members"]))
        self._received_at = {learners[int(u)]: int(n) for u, n in arrays["taken_at"]}
        if self.is_member:
            self._use(restrict(self._founding_schedule, self.members))
