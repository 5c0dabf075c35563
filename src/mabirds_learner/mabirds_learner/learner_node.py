"""One learner as a ROS node: parameters, conversion, a call into core, a publication.

Started in the namespace of its name (/learner_1). It subscribes to its own demonstrations and to the parameters of
its scheduled in-neighbours, and to nothing else.
"""

import time
from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any

from mabirds_msgs.msg import Demonstration, EdgeSchedule, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from mabirds_msgs.srv import FetchParameters
from rclpy.client import Client
from rclpy.node import Node

from mabirds_core.assembly import build_learner
from mabirds_core.errors import ExperimentError
from mabirds_core.metrics import norms
from mabirds_learner.session import StrictSession, default_history
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import (
    RefusedMessageError,
    parameters_message,
    read_demonstration,
    read_parameters,
    schedule_message,
    time_message,
)
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.node_main import run_node
from mabirds_msgs_py.qos import STATUS_QOS, latched
from mabirds_msgs_py.ros_parameters import declare_experiment, experiment_of, real, whole

REPETITIONS = {"old_iteration", "duplicate"}
"""Reasons that are only counted: what is asked for again may arrive twice."""


class LearnerNode(Node):
    """Learner v of an experiment, in strict mode. Raises MabirdsError for a wrong experiment, name or history."""

    def __init__(self, **node_options: Any) -> None:
        super().__init__("learner", **node_options)
        self._declare_parameters()
        self._fleet, self.learner_name = topics.split_namespace(self.get_namespace())
        if not self.learner_name:
            raise ExperimentError("no namespace: a learner's namespace is its name; start with -r __ns:=/learner_1")
        experiment, self._experiment_digest = experiment_of(self)
        learner = build_learner(experiment, self.learner_name)
        self._parameter_history = self._value("parameter_history") or default_history(learner.schedule)
        self.session = StrictSession(
            learner, experiment.iterations, self._value("demonstration_history"), self._parameter_history
        )
        self._game, self._schedule = learner.game, learner.schedule
        self._stalled_at = 0
        self._drops: Counter[str] = Counter()
        self._metrics = norms(self.session.state.parameters)
        self._event = ""
        self._create_outputs()
        self._create_inputs()
        self._publish_parameters()
        self._publish_status()

    def _declare_parameters(self) -> None:
        declare_experiment(self)
        self.declare_parameter(
            "demonstration_history", 256, whole("demonstrations kept ahead of the current iteration", 256, 100_000)
        )
        self.declare_parameter(
            "parameter_history",
            0,
            whole("iterations of parameters kept; 0: as many as the schedule needs, at least 64", 0, 100_000),
        )
        self.declare_parameter(
            "status_period", 1.0, real("seconds between two status messages while nothing changes", 0.05, 60.0)
        )

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _create_outputs(self) -> None:
        history = latched(self._parameter_history)
        self._parameter_publisher = self.create_publisher(ParametersMessage, topics.PARAMETERS, history)
        # As deep, so that a recorder gets every status; readers that want the newest only ask for a depth of 1.
        self._status_publisher = self.create_publisher(LearnerStatus, topics.STATUS, history)
        self._schedule_publisher = self.create_publisher(EdgeSchedule, topics.EDGE_SCHEDULE, STATUS_QOS)
        self._schedule_publisher.publish(schedule_message(self._schedule))

    def _create_inputs(self) -> None:
        history = latched(self._value("demonstration_history"))
        self.create_subscription(Demonstration, topics.DEMONSTRATION, self._on_demonstration, history)
        self._fetch: dict[int, Client] = {}
        for neighbour in self._schedule.ever_in_neighbours(self.session.learner.index):
            self._listen_to(neighbour)
        self.create_service(FetchParameters, topics.FETCH_PARAMETERS, self._on_fetch)
        self.create_timer(self._value("status_period"), self._on_timer)
        # Triggered when the next update can be made, so that each is a callback of its own and others get a turn.
        self._next = self.create_guard_condition(self._advance)

    def _listen_to(self, neighbour: int) -> None:
        name = self._schedule.learners[neighbour]
        topic = f"{self._fleet}{name}/{topics.PARAMETERS}"
        history = latched(self._parameter_history)
        self.create_subscription(ParametersMessage, topic, partial(self._on_parameters, neighbour), history)
        self._fetch[neighbour] = self.create_client(FetchParameters, f"{self._fleet}{name}/{topics.FETCH_PARAMETERS}")

    def _on_demonstration(self, message: Demonstration) -> None:
        try:
            trajectory = read_demonstration(self._game, self.learner_name, message, self._experiment_digest)
            self.session.receive_demonstration(message.iteration, trajectory)
        except RefusedMessageError as error:
            self._drop(f"{topics.DEMONSTRATION} {message.iteration}", error)
        self._continue()

    def _on_parameters(self, neighbour: int, message: ParametersMessage) -> None:
        name = self._schedule.learners[neighbour]
        like = self.session.state.parameters
        try:
            parameters = read_parameters(message, name, self._experiment_digest, self._schedule.digest, like)
            self.session.receive_parameters(neighbour, message.iteration, parameters)
        except RefusedMessageError as error:
            self._drop(f"{topics.PARAMETERS} {message.iteration} of {name}", error)
        self._continue()

    def _drop(self, what: str, error: RefusedMessageError) -> None:
        self._drops[error.reason] += 1
        if error.reason in REPETITIONS:
            return
        self._event = f"dropped {what}: {error}"
        if self._drops[error.reason] == 1:
            self.get_logger().warning(self._event)

    def _continue(self) -> None:
        self._publish_status()
        if self.session.ready:
            self._next.trigger()

    def _advance(self) -> None:
        """One update, if everything for it is there."""
        if not self.session.ready:
            return
        start = time.perf_counter()
        update = self.session.step()
        seconds = time.perf_counter() - start
        self._metrics = {
            "iteration_seconds": seconds,
            **norms(update.state.parameters),
            **{f"gradient_{name}": value for name, value in norms(update.gradient).items()},
        }
        self._publish_parameters()
        self._continue()
        if self.session.finished:
            self.get_logger().info(f"{self.learner_name}: all {self.session.iteration - 1} demonstrations learned")

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
            response.message = f"{self.learner_name} keeps iterations {oldest} to {newest}"
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

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds

    def _parameters_message(self, iteration: int, parameters: Any) -> ParametersMessage:
        return parameters_message(
            self.learner_name, iteration, parameters, self._experiment_digest, self._schedule.digest, self._now()
        )

    def _publish_parameters(self) -> None:
        state = self.session.state
        self._parameter_publisher.publish(self._parameters_message(state.iteration, state.parameters))

    def _publish_status(self) -> None:
        session = self.session
        message = LearnerStatus(
            learner=self.learner_name,
            game_digest=self._game.digest,
            experiment_digest=self._experiment_digest,
            schedule_digest=self._schedule.digest,
            state=self._state(),
            iteration=session.iteration,
            last_demonstration=session.iteration - 1,
            backlog=session.backlog,
            waiting_for=session.waiting_for(),
            mixed_from=session.mixed_from,
            metric_names=list(self._metrics),
            metric_values=list(self._metrics.values()),
            drop_reasons=list(self._drops),
            drop_counts=list(self._drops.values()),
            message=self._event,
        )
        message.stamp = time_message(self._now())
        self._status_publisher.publish(message)

    def _state(self) -> int:
        if self.session.finished:
            return LearnerStatus.FINISHED
        if self.session.missing_demonstration:
            return LearnerStatus.WAITING_FOR_DEMONSTRATION
        waiting = bool(self.session.missing_neighbours())
        return LearnerStatus.WAITING_FOR_NEIGHBOURS if waiting else LearnerStatus.LEARNING


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
