"""One learner as a ROS node: parameters, conversion, a call into core, a publication.

Started in the namespace of its name (/learner_1). It subscribes to its own demonstrations and to the parameters of
its scheduled in-neighbours, and to nothing else.
"""

from collections.abc import Sequence
from functools import partial
from typing import Any

from mabirds_msgs.msg import Demonstration
from mabirds_msgs.msg import Parameters as ParametersMessage
from mabirds_msgs.srv import FetchParameters
from rclpy.client import Client

from mabirds_core.assembly import build_learner
from mabirds_learner.progress_node import ProgressNode
from mabirds_learner.session import StrictSession, default_history
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import RefusedMessageError, read_demonstration, read_parameters
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.node_main import run_node
from mabirds_msgs_py.qos import latched
from mabirds_msgs_py.ros_parameters import whole


class LearnerNode(ProgressNode):
    """Learner v of an experiment, in strict mode. Raises MabirdsError for a wrong experiment, name or history."""

    session: StrictSession

    def __init__(self, **node_options: Any) -> None:
        super().__init__("learner", **node_options)
        self.declare_parameter(
            "parameter_history",
            0,
            whole("iterations of parameters kept; 0: as many as the schedule needs, at least 64", 0, 100_000),
        )
        learner = build_learner(self._experiment, self.own_name)
        self._parameter_history = self._value("parameter_history") or default_history(learner.schedule)
        self.session = StrictSession(
            learner,
            self._experiment.iterations,
            self._value("demonstration_history"),
            self._parameter_history,
            self._experiment.closing_rounds,
        )
        self._stalled_at = 0
        self.begin(learner.game, self._parameter_history)
        self._create_inputs()

    def _create_inputs(self) -> None:
        history = latched(self._value("demonstration_history"))
        self.create_subscription(Demonstration, topics.DEMONSTRATION, self._on_demonstration, history)
        self._fetch: dict[int, Client] = {}
        for neighbour in self._schedule.ever_in_neighbours(self.session.learner.index):
            self._listen_to(neighbour)
        self.create_service(FetchParameters, topics.FETCH_PARAMETERS, self._on_fetch)

    def _listen_to(self, neighbour: int) -> None:
        name = self._schedule.learners[neighbour]
        topic = f"{self._fleet}{name}/{topics.PARAMETERS}"
        history = latched(self._parameter_history)
        self.create_subscription(ParametersMessage, topic, partial(self._on_parameters, neighbour), history)
        self._fetch[neighbour] = self.create_client(FetchParameters, f"{self._fleet}{name}/{topics.FETCH_PARAMETERS}")

    def _on_demonstration(self, message: Demonstration) -> None:
        try:
            trajectory = read_demonstration(self._game, self.own_name, message, self._experiment_digest)
            self.session.receive_demonstration(message.iteration, trajectory)
        except RefusedMessageError as error:
            self._drop(f"{topics.DEMONSTRATION} {message.iteration}", error)
        self._continue()

    def _on_parameters(self, neighbour: int, message: ParametersMessage) -> None:
        name, like = self._schedule.learners[neighbour], self.session.parameters
        try:
            parameters = read_parameters(message, name, self._experiment_digest, self._schedule.digest, like)
            self.session.receive_parameters(neighbour, message.iteration, parameters)
        except RefusedMessageError as error:
            self._drop(f"{topics.PARAMETERS} {message.iteration} of {name}", error)
        self._continue()

    def _on_timer(self) -> None:
        """Say that this learner lives, and ask again for what has been missing since the last time."""
        self._publish_status()
        stalled, self._stalled_at = self._stalled_at == self.session.iteration, self.session.iteration
        for neighbour in self.session.missing_neighbours() if stalled else ():
            self._ask_again(neighbour)

    def _ask_again(self, neighbour: int) -> None:
        client = self._fetch[neighbour]
        if client.service_is_ready():
            request = FetchParameters.Request(iteration=self.session.iteration)
            client.call_async(request).add_done_callback(partial(self._on_fetched, neighbour))

    def _on_fetch(
        self, request: FetchParameters.Request, response: FetchParameters.Response
    ) -> FetchParameters.Response:
        parameters = self.session.own_parameters(request.iteration)
        response.found = parameters is not None
        if parameters is None:
            oldest, newest = self.session.kept
            response.message = f"{self.own_name} keeps iterations {oldest} to {newest}"
        else:
            response.parameters = self._parameters_message(request.iteration, parameters)
        return response

    def _on_fetched(self, neighbour: int, future: Any) -> None:
        response = future.result()
        if response is None or neighbour not in self.session.missing_neighbours():
            return
        if response.found:
            self._on_parameters(neighbour, response.parameters)
        else:
            self._event = f"iteration {self.session.iteration} is missing: {response.message}"


HELP = """Run one learner. Its name is its namespace; its process holds its own demonstrations only.

usage: mabirds-learner --ros-args -r __ns:=/NAME -p experiment:=FILE [-p PARAMETER:=VALUE ...]

example: mabirds-learner --ros-args -r __ns:=/learner_1 -p experiment:=ros_ws/config/patrol.yaml

parameters:
  experiment              path of the experiment file (YAML)
  demonstration_history   demonstrations kept ahead of the current iteration (256)
  run                     name of this run; messages of other runs are refused ("")
  parameter_history       iterations of parameters kept; 0: as many as the schedule needs, at least 64 (0)
  status_period           seconds between status messages while nothing changes (1.0)

It ends on SIGINT or SIGTERM. Exit codes: 0 ended as asked, 2 wrong experiment, name or parameter."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``mabirds-learner``."""
    prepare_environment()
    return run_node(LearnerNode, HELP, arguments)
