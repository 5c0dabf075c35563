"""Strict mode as ROS entities: parameters of scheduled in-neighbours, and asking again for what is missing."""

from functools import partial
from typing import TYPE_CHECKING, Any

from mabirds_msgs.msg import Parameters as ParametersMessage
from mabirds_msgs.srv import FetchParameters
from rclpy.client import Client

from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.texts import printable
from mabirds_learner.session import StrictSession
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import read_parameters
from mabirds_msgs_py.qos import announced

if TYPE_CHECKING:
    from mabirds_learner.learner_node import LearnerNode


class StrictExchange:
    """What a learner node hears of its neighbours in strict mode. What it tells them is its parameters topic."""

    def __init__(self, node: "LearnerNode") -> None:
        self._node = node
        self.session = StrictSession(build_learner(node.experiment, node.own_name), *node.limits)
        self._fetch: dict[str, Client] = {}
        self._stalled_at = 0

    def connect(self) -> None:
        """Listen to every learner that is an in-neighbour at some iteration."""
        for neighbour in self._node.schedule.ever_in_neighbours(self.session.learner.index):
            self._listen_to(neighbour)

    def _listen_to(self, neighbour: int) -> None:
        name, node = self._node.schedule.learners[neighbour], self._node
        node.create_subscription(
            ParametersMessage,
            f"{node.fleet}{name}/{topics.PARAMETERS}",
            partial(self._on_parameters, neighbour),
            announced(node.parameter_history),
            event_callbacks=node.presence.watch(name),
        )
        self._fetch[name] = node.create_client(FetchParameters, f"{node.fleet}{name}/{topics.FETCH_PARAMETERS}")

    def publish(self) -> None:
        """Nothing: neighbours hear theta and omega themselves."""

    def on_presence(self, name: str, *, gone: bool) -> None:
        """Nothing: a neighbour is waited for, however long."""

    def _on_parameters(self, neighbour: int, message: ParametersMessage) -> None:
        node = self._node
        name, like = node.schedule.learners[neighbour], self.session.parameters
        try:
            parameters = read_parameters(message, name, node.experiment_digest, node.schedule.digest, like)
            self.session.receive_parameters(neighbour, message.iteration, parameters)
        except RefusedMessageError as error:
            node.drop(f"{topics.PARAMETERS} {message.iteration} of {name}", error)
        else:
            node.go_on()

    def on_timer(self) -> None:
        """Ask again for what has been missing since the last time."""
        stalled, self._stalled_at = self._stalled_at == self.session.iteration, self.session.iteration
        for name in self.session.missing_neighbours() if stalled else ():
            client = self._fetch[name]
            if client.service_is_ready():
                request = FetchParameters.Request(iteration=self.session.iteration)
                client.call_async(request).add_done_callback(partial(self._on_fetched, name))

    def _on_fetched(self, name: str, future: Any) -> None:
        response = future.result()
        if response is None or name not in self.session.missing_neighbours():
            return
        if response.found:
            self._on_parameters(self._node.schedule.learners.index(name), response.parameters)
        else:
            self._node.say(f"iteration {self.session.iteration} is missing: {printable(response.message)}", log=False)
