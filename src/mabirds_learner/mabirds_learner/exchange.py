"""What a learner node and the exchange with its neighbours are to each other: narrow, so that neither reads the other.

An exchange is given an outlet to the network and says by a callback that something has changed.
"""

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

from builtin_interfaces.msg import Time

from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.errors import RefusedMessageError


class Exchange(Protocol):
    """What a learner tells its neighbours and hears of them."""

    def connect(self) -> None:
        """Meet every learner that is a neighbour at some iteration."""
        ...

    def publish(self) -> None:
        """Tell neighbours what an update led to."""
        ...

    def on_presence(self, name: str, *, alive: bool) -> None:
        """The process of a neighbour is gone, or back."""
        ...

    def on_timer(self) -> None:
        """Mend what has been missing since the last time."""
        ...


class Identity(NamedTuple):
    """Who a learner is: its name, and the experiment and schedule that its messages belong to."""

    learner_name: str
    experiment_digest: str
    schedule: EdgeSchedule


class Timer(Protocol):
    """Calls back over and over."""

    def reset(self) -> None:
        """Begin the period anew."""
        ...


OnMessage = Callable[[Any], None]
Publish = Callable[[Any], None]
Call = Callable[[Any, Callable[[Any], None]], None]
"""A request, and who is given the response; nothing happens while the service is not there."""


class Outlet(Protocol):
    """All that an exchange may do on the network and say to people. Topics of a learner are below its name."""

    def publisher(self, message_type: type, topic: str) -> Publish:
        """Publish on a topic of this learner, with its history for those who come late."""
        ...

    def subscribe(self, message_type: type, neighbour: str, topic: str, on_message: OnMessage) -> None:
        """Listen to a topic of a neighbour, and watch whether its process lives."""
        ...

    def subscribe_to_all(self, message_type: type, topic: str, on_message: OnMessage, depth: int) -> None:
        """Listen to a topic that belongs to no learner, and get its last ``depth`` messages."""
        ...

    def caller(self, service_type: type, neighbour: str, service: str) -> Call:
        """Call a service of a neighbour."""
        ...

    def timer(self, seconds: float, on_time: Callable[[], None]) -> Timer:
        """Be called every so many seconds."""
        ...

    def stamp(self) -> Time:
        """The present time for a message."""
        ...

    def set_event(self, words: str, *, log: bool = True) -> None:
        """Tell people, in the statuses from now on and in the log."""
        ...

    def reject(self, what: str, error: RefusedMessageError) -> None:
        """Count a message that is not used, and say why."""
        ...
