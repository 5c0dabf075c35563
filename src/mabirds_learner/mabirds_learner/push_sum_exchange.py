"""Resilient mode as ROS entities: running sums to and from scheduled neighbours, and declarations of members."""

from collections.abc import Callable
from functools import partial

from mabirds_msgs.msg import Mass, Membership

from mabirds_core.errors import RefusedMessageError
from mabirds_learner.exchange import Identity, Outlet, Publish
from mabirds_learner.learner_session import LearnerSession
from mabirds_learner.push_sum_member import PushSumMember
from mabirds_msgs_py import topics
from mabirds_msgs_py.mass_conversion import mass_message, read_mass, read_membership

MEMBERSHIP_HISTORY = 16
"""Declarations that a late joiner still gets; the newest decides."""


class PushSumExchange:
    """What a learner tells its neighbours and hears of them in resilient mode.

    Parameters
    ----------
    session : LearnerSession[PushSumMember]
        Of the learner.
    identity : Identity
        Of the learner.
    outlet : Outlet
        To the network.
    on_change : Callable[[], None]
        Called when something has arrived.
    patience : float
        Seconds for which late neighbours are waited for.
    save : Callable[[], None]
        Called before neighbours hear of a new beginning.
    key : bytes, optional
        With which declarations must be signed; empty: whoever declares is believed.
    """

    def __init__(
        self,
        session: LearnerSession[PushSumMember],
        identity: Identity,
        outlet: Outlet,
        on_change: Callable[[], None],
        *,
        patience: float,
        save: Callable[[], None],
        key: bytes = b"",
    ) -> None:
        self._session, self._member, self._identity, self._outlet = session, session.member, identity, outlet
        self._patience, self._on_change, self._save, self._key = patience, on_change, save, key
        self._publishers: dict[str, Publish] = {}
        self._waits_at: tuple[int, int, bool] | None = None

    def connect(self) -> None:
        """Meet every learner that is a neighbour at some iteration, and hear of declarations."""
        learner_name, _, schedule = self._identity
        index = self._session.learner.index
        for receiver in sorted({receiver for sender, receiver in schedule.all_edges if sender == index}):
            name = schedule.learners[receiver]
            self._publishers[name] = self._outlet.publisher(Mass, topics.mass(name))
        for name in (schedule.learners[sender] for sender in schedule.all_in_neighbours(index)):
            self._outlet.subscribe(Mass, name, topics.mass(learner_name), partial(self._on_mass, name))
        self._outlet.subscribe_to_all(Membership, topics.MEMBERSHIP, self._on_membership, MEMBERSHIP_HISTORY)
        self._timer = self._outlet.timer(self._patience, self._on_patience)
        self.publish()

    def publish(self) -> None:
        """Tell out-neighbours of E(n) all that they were sent."""
        session, (learner_name, experiment_digest, schedule) = self._session, self._identity
        for name, total in self._member.outgoing().items():
            message = mass_message(learner_name, name, session.epoch, session.iteration, total)
            message.experiment_digest, message.schedule_digest = experiment_digest, schedule.digest
            message.stamp = self._outlet.stamp()
            self._publishers[name](message)
        self._watch_the_time()

    def _watch_the_time(self) -> None:
        """Patience begins when neighbours are all that is missing. The timer is never cancelled, only begun anew."""
        at = (self._session.epoch, self._session.iteration, self._session.missing_demonstration)
        if at != self._waits_at:
            self._waits_at = at
            self._timer.reset()

    def _on_patience(self) -> None:
        session = self._session
        if not session.finished and not session.missing_demonstration and session.missing_neighbours():
            self._member.give_up_waiting()
            self._on_change()

    def on_presence(self, name: str, *, alive: bool) -> None:
        """A neighbour whose process is gone is not waited for."""
        self._member.set_alive(name, alive=alive)

    def on_timer(self) -> None:
        """Nothing to send again: the next running sums hold what is missing."""

    def _on_mass(self, name: str, message: Mass) -> None:
        learner_name, experiment_digest, schedule = self._identity
        joining = self._member.joining
        try:
            size = self._member.push_sum.mass.size
            total = read_mass(message, name, learner_name, experiment_digest, schedule.digest, size)
            self._member.receive_mass(name, message.epoch, message.iteration, total)
        except RefusedMessageError as error:
            self._outlet.note_stranger(name, message, error)
            self._outlet.reject(f"mass {message.iteration} of {name}", error)
            return
        if joining and not self._member.joining:
            self._start_anew(f"joined at iteration {self._session.iteration}")
        self._watch_the_time()
        self._on_change()

    def _on_membership(self, message: Membership) -> None:
        try:
            members = read_membership(message, self._identity.experiment_digest, self._key)
            self._member.follow(message.epoch, members)
        except RefusedMessageError as error:
            self._outlet.reject(f"declaration of epoch {message.epoch}", error)
            return
        self._start_anew(f"epoch {self._session.epoch}: {', '.join(self._member.members)}")
        self._on_change()

    def _start_anew(self, words: str) -> None:
        self._outlet.set_event(words)
        self._save()
        self.publish()
