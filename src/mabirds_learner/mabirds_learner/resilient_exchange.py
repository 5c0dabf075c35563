"""Resilient mode as ROS entities: running sums to and from scheduled neighbours, and declarations of members."""

from functools import partial
from typing import TYPE_CHECKING

from mabirds_msgs.msg import Mass, Membership
from rclpy.publisher import Publisher

from mabirds_core.consensus.settings import ResilientMixing
from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_resilient_learner
from mabirds_learner.resilient_session import ResilientSession
from mabirds_msgs_py import topics
from mabirds_msgs_py.mass_conversion import mass_message, read_mass, read_membership
from mabirds_msgs_py.qos import announced, latched

if TYPE_CHECKING:
    from mabirds_learner.learner_node import LearnerNode

MEMBERSHIP_HISTORY = 16
"""Declarations that a late joiner still gets; the newest decides."""


class ResilientExchange:
    """What a learner node tells its neighbours and hears of them in resilient mode."""

    def __init__(self, node: "LearnerNode", mixing: ResilientMixing) -> None:
        self._node, self._mixing = node, mixing
        learner = build_resilient_learner(node.experiment, node.own_name)
        self.session = ResilientSession(learner, *node.limits, newcomer=node.value("newcomer"))
        self._publishers: dict[str, Publisher] = {}
        self._waits_at: tuple[int, int, bool] | None = None

    def connect(self) -> None:
        """Meet every learner that is a neighbour at some iteration, and hear of declarations."""
        node, schedule, own = self._node, self._node.schedule, self.session.learner.index
        for receiver in sorted({receiver for sender, receiver in schedule.all_edges if sender == own}):
            name = schedule.learners[receiver]
            self._publishers[name] = node.create_publisher(Mass, topics.mass(name), announced(node.parameter_history))
        for sender in schedule.ever_in_neighbours(own):
            self._listen_to(schedule.learners[sender])
        node.create_subscription(
            Membership, f"{node.fleet}{topics.MEMBERSHIP}", self._on_membership, latched(MEMBERSHIP_HISTORY)
        )
        self._patience = node.create_timer(self._mixing.patience, self._on_patience)
        self.publish()

    def _listen_to(self, name: str) -> None:
        node = self._node
        node.create_subscription(
            Mass,
            f"{node.fleet}{name}/{topics.mass(node.own_name)}",
            partial(self._on_mass, name),
            announced(node.parameter_history),
            event_callbacks=node.presence.watch(name),
        )

    def publish(self) -> None:
        """Tell out-neighbours of E(n) all that they were given."""
        node, session = self._node, self.session
        for name, total in session.given().items():
            message = mass_message(node.own_name, name, session.epoch, session.iteration, total)
            message.experiment_digest, message.schedule_digest = node.experiment_digest, node.schedule.digest
            message.stamp = node.stamp()
            self._publishers[name].publish(message)
        self._watch_the_time()

    def _watch_the_time(self) -> None:
        """Patience begins when neighbours are all that is missing. The timer is never cancelled, only begun anew."""
        at = (self.session.epoch, self.session.iteration, self.session.missing_demonstration)
        if at != self._waits_at:
            self._waits_at = at
            self._patience.reset()

    def _on_patience(self) -> None:
        if not self.session.finished and not self.session.missing_demonstration and self.session.missing_neighbours():
            self.session.stop_waiting()
            self._node.go_on()

    def on_presence(self, name: str, *, gone: bool) -> None:
        """A neighbour whose process is gone is not waited for."""
        self.session.set_gone(name, gone=gone)

    def on_timer(self) -> None:
        """Nothing: what is missing is in what comes next."""

    def _on_mass(self, name: str, message: Mass) -> None:
        node, before = self._node, self.session.joining
        try:
            size = self.session.state.ledger.own.size
            total = read_mass(message, name, node.own_name, node.experiment_digest, node.schedule.digest, size)
            self.session.receive_sum(name, message.epoch, message.iteration, total)
        except RefusedMessageError as error:
            node.drop(f"mass {message.iteration} of {name}", error)
            return
        if before and not self.session.joining:
            self._start_anew(f"joined at iteration {self.session.iteration}")
        self._watch_the_time()
        node.go_on()

    def _on_membership(self, message: Membership) -> None:
        try:
            members = read_membership(message, self._node.experiment_digest)
            self.session.follow(message.epoch, members)
        except RefusedMessageError as error:
            self._node.drop(f"declaration of epoch {message.epoch}", error)
            return
        self._start_anew(f"epoch {self.session.epoch}: {', '.join(self.session.members)}")
        self._node.go_on()

    def _start_anew(self, words: str) -> None:
        self._node.say(words)
        self._node.keep()
        self.publish()
