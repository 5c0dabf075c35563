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
        """The process of a neighbour is gone, or back.

        Parameters
        ----------
        name : str
            Of the neighbour.
        alive : bool
            It is back.
        """
        ...

    def on_timer(self) -> None:
        """Mend what has been missing since the last time."""
        ...


class Identity(NamedTuple):
    """Who a learner is, and what its messages belong to.

    Attributes
    ----------
    learner_name : str
        Its name.
    experiment_digest : str
        Of the run.
    schedule : EdgeSchedule
        E(n).
    """

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
        """Publish on a topic of this learner, with its history for those who come late.

        Parameters
        ----------
        message_type : type
            Of the topic.
        topic : str
            Below the learner's name.

        Returns
        -------
        Publish
            Sends a message.
        """
        ...

    def subscribe(self, message_type: type, neighbour: str, topic: str, on_message: OnMessage) -> None:
        """Listen to a topic of a neighbour, and watch whether its process lives.

        Parameters
        ----------
        message_type : type
            Of the topic.
        neighbour : str
            Its name.
        topic : str
            Below the neighbour's name.
        on_message : OnMessage
            Called with each.
        """
        ...

    def subscribe_to_all(self, message_type: type, topic: str, on_message: OnMessage, depth: int) -> None:
        """Listen to a topic that belongs to no learner.

        Parameters
        ----------
        message_type : type
            Of the topic.
        topic : str
            Its name.
        on_message : OnMessage
            Called with each.
        depth : int
            How many earlier messages are heard, too.
        """
        ...

    def caller(self, service_type: type, neighbour: str, service: str) -> Call:
        """Call a service of a neighbour.

        Parameters
        ----------
        service_type : type
            Of the service.
        neighbour : str
            Its name.
        service : str
            Below the neighbour's name.

        Returns
        -------
        Call
            Sends a request.
        """
        ...

    def timer(self, seconds: float, on_time: Callable[[], None]) -> Timer:
        """Be called over and over.

        Parameters
        ----------
        seconds : float
            Between two calls.
        on_time : Callable[[], None]
            What is called.

        Returns
        -------
        Timer
            Runs already.
        """
        ...

    def stamp(self) -> Time:
        """The present time for a message."""
        ...

    def set_event(self, words: str, *, log: bool = True) -> None:
        """Tell people, in the statuses from now on.

        Parameters
        ----------
        words : str
            A sentence.
        log : bool, optional
            Tell it in the log, too.
        """
        ...

    def note_stranger(self, name: str, message: Any, error: RefusedMessageError) -> None:
        """Somebody else publishes as a neighbour, where a message is of another run.

        Parameters
        ----------
        name : str
            Of the neighbour.
        message : Any
            It names its run by ``experiment_digest``.
        error : RefusedMessageError
            Why it is not used.
        """
        ...

    def reject(self, what: str, error: RefusedMessageError) -> None:
        """Count a message that is not used, and say why.

        Parameters
        ----------
        what : str
            Which message it is.
        error : RefusedMessageError
            Why.
        """
        ...
