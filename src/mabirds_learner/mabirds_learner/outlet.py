"""The outlet that a learner node gives to its exchange."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from builtin_interfaces.msg import Time

from mabirds_core.errors import RefusedMessageError
from mabirds_learner.exchange import Call, OnMessage, Publish, Timer
from mabirds_learner.progress_node import ProgressNode
from mabirds_msgs_py.presence import LivelinessMonitor
from mabirds_msgs_py.qos import announced, latched


@dataclass(frozen=True)
class NodeOutlet:
    """The outlet of a node.

    Attributes
    ----------
    node : ProgressNode
        Of the learner.
    presence : LivelinessMonitor
        Is told of every neighbour that is heard.
    history : int
        Messages kept for those who come late.
    """

    node: ProgressNode
    presence: LivelinessMonitor
    history: int

    def publisher(self, message_type: type, topic: str) -> Publish:
        """Publish on a topic of this learner."""
        publish: Publish = self.node.create_publisher(message_type, topic, announced(self.history)).publish
        return publish

    def subscribe(self, message_type: type, neighbour: str, topic: str, on_message: OnMessage) -> None:
        """Listen to a topic of a neighbour, and watch whether its process lives."""
        self.node.create_subscription(
            message_type,
            f"{self.node.namespace_prefix}{neighbour}/{topic}",
            on_message,
            announced(self.history),
            event_callbacks=self.presence.watch(neighbour),
        )

    def subscribe_to_all(self, message_type: type, topic: str, on_message: OnMessage, depth: int) -> None:
        """Listen to a topic that belongs to no learner."""
        full_name = f"{self.node.namespace_prefix}{topic}"
        self.node.create_subscription(message_type, full_name, on_message, latched(depth))

    def caller(self, service_type: type, neighbour: str, service: str) -> Call:
        """Call a service of a neighbour."""
        client = self.node.create_client(
            service_type, f"{self.node.namespace_prefix}{neighbour}/{self.node.service_name(service)}"
        )

        def call(request: object, on_response: Callable[[object], None]) -> None:
            if client.service_is_ready():
                client.call_async(request).add_done_callback(lambda future: on_response(future.result()))

        return call

    def timer(self, seconds: float, on_time: Callable[[], None]) -> Timer:
        """Be called every so many seconds."""
        timer: Timer = self.node.create_timer(seconds, on_time)
        return timer

    def stamp(self) -> Time:
        """The present time for a message."""
        return self.node.stamp()

    def set_event(self, words: str, *, log: bool = True) -> None:
        """Tell people of an event."""
        self.node.set_event(words, log=log)

    def note_stranger(self, name: str, message: Any, error: RefusedMessageError) -> None:
        """Somebody else publishes as a neighbour, where a message is of another run."""
        if error.reason == "wrong_experiment":
            self.presence.note_stranger(name, message.experiment_digest)

    def reject(self, what: str, error: RefusedMessageError) -> None:
        """Count a message that is not used."""
        self.node.reject(what, error)
