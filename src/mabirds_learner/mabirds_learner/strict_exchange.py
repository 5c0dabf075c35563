"""Strict mode as ROS entities: parameters of scheduled in-neighbours, and asking again for what is missing."""

from collections.abc import Callable
from functools import partial
from typing import Any

from mabirds_msgs.msg import Parameters as ParametersMessage
from mabirds_msgs.srv import FetchParameters

from mabirds_core.errors import RefusedMessageError
from mabirds_core.texts import sanitize
from mabirds_learner.exchange import Call, Identity, Outlet
from mabirds_learner.learner_session import LearnerSession
from mabirds_learner.strict_member import StrictMember
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import read_parameters


class StrictExchange:
    """What a learner hears of its neighbours in strict mode. What it tells them is its parameters topic.

    Parameters
    ----------
    session : LearnerSession[StrictMember]
        Of the learner.
    identity : Identity
        Of the learner.
    outlet : Outlet
        To the network.
    on_change : Callable[[], None]
        Called when something has arrived.
    """

    def __init__(
        self,
        session: LearnerSession[StrictMember],
        identity: Identity,
        outlet: Outlet,
        on_change: Callable[[], None],
    ) -> None:
        self._session, self._identity, self._outlet, self._on_change = session, identity, outlet, on_change
        self._fetch: dict[str, Call] = {}
        self._stalled_at = 0

    def connect(self) -> None:
        """Listen to every learner that is an in-neighbour at some iteration."""
        schedule, index = self._identity.schedule, self._session.learner.index
        for name in (schedule.learners[sender] for sender in schedule.all_in_neighbours(index)):
            self._outlet.subscribe(ParametersMessage, name, topics.PARAMETERS, partial(self._on_parameters, name))
            self._fetch[name] = self._outlet.caller(FetchParameters, name, topics.FETCH_PARAMETERS)

    def publish(self) -> None:
        """Nothing to publish: neighbours hear theta and omega themselves."""

    def on_presence(self, name: str, *, alive: bool) -> None:
        """Nothing to do: a neighbour is waited for, however long."""

    def _on_parameters(self, name: str, message: ParametersMessage) -> None:
        _, experiment_digest, schedule = self._identity
        try:
            parameters = read_parameters(message, name, experiment_digest, schedule.digest, self._session.parameters)
            self._session.member.receive_parameters(name, message.iteration, parameters)
        except RefusedMessageError as error:
            self._outlet.note_stranger(name, message, error)
            self._outlet.reject(f"{topics.PARAMETERS} {message.iteration} of {name}", error)
        else:
            self._on_change()

    def on_timer(self) -> None:
        """Ask again for what has been missing since the last time."""
        stalled, self._stalled_at = self._stalled_at == self._session.iteration, self._session.iteration
        for name in self._session.missing_neighbours() if stalled else ():
            self._fetch[name](
                FetchParameters.Request(iteration=self._session.iteration), partial(self._on_fetched, name)
            )

    def _on_fetched(self, name: str, response: Any) -> None:
        if response is None or name not in self._session.missing_neighbours():
            return
        if response.found:
            self._on_parameters(name, response.parameters)
        else:
            words = f"iteration {self._session.iteration} is missing: {sanitize(response.message)}"
            self._outlet.set_event(words, log=False)
