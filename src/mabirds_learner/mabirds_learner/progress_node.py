"""What learner and central nodes share: one update after the other, each published with where the node stands."""

import time
from collections import Counter
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from mabirds_msgs.msg import EdgeSchedule, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy.node import Node

from mabirds_core.errors import ExperimentError
from mabirds_core.games.interface import ConstrainedMarkovGame
from mabirds_core.metrics import norms
from mabirds_core.parameters import Parameters
from mabirds_learner.diagnostics import HARMLESS, diagnostic_message
from mabirds_learner.progress import Session
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import RefusedMessageError, parameters_message, schedule_message, time_message
from mabirds_msgs_py.qos import STATUS_QOS, latched
from mabirds_msgs_py.ros_parameters import declare_experiment, experiment_of, real, whole

STATUSES_AN_ITERATION = 8
"""No more than these, as a rule: one for each arrival, one for the update, one for each second in between."""

DIAGNOSTICS_PERIOD = 1.0
"""Seconds between two messages to /diagnostics, as diagnostic aggregators expect."""

DIAGNOSTICS_DEPTH = 10
"""The default depth of /diagnostics."""


class ProgressNode(Node):
    """A node that learns: its name is its namespace. Raises MabirdsError for a wrong experiment or no namespace.

    A subclass creates ``session`` and its inputs, and then calls ``begin``.
    """

    session: Session

    def __init__(self, kind: str, **node_options: Any) -> None:
        super().__init__(kind, **node_options)
        declare_experiment(self)
        self.declare_parameter(
            "demonstration_history", 256, whole("demonstrations kept ahead of the current iteration", 256, 100_000)
        )
        self.declare_parameter(
            "status_period", 1.0, real("seconds between two status messages while nothing changes", 0.05, 60.0)
        )
        self._fleet, self.own_name = topics.split_namespace(self.get_namespace())
        if not self.own_name:
            raise ExperimentError("no namespace: a learner's namespace is its name; start with -r __ns:=/learner_1")
        self._experiment, self._experiment_digest = experiment_of(self)
        self._schedule = self._experiment.edge_schedule
        self._drops: Counter[str] = Counter()
        self._event = ""

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def begin(self, game: ConstrainedMarkovGame, history: int) -> None:
        """Announce theta(1), omega(1) and the status; ``history``: messages kept for those who come late."""
        self._game = game
        self._metrics = norms(self.session.parameters)
        self._parameter_publisher = self.create_publisher(ParametersMessage, topics.PARAMETERS, latched(history))
        # Deeper, so that a recorder gets every status; readers that want the newest only ask for a depth of 1.
        depth = STATUSES_AN_ITERATION * history
        self._status_publisher = self.create_publisher(LearnerStatus, topics.STATUS, latched(depth))
        self._schedule_publisher = self.create_publisher(EdgeSchedule, topics.EDGE_SCHEDULE, STATUS_QOS)
        self._schedule_publisher.publish(schedule_message(self._schedule))
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, DIAGNOSTICS_DEPTH)
        self._diagnosed_at = 0
        self.create_timer(self._value("status_period"), self._on_timer)
        self.create_timer(DIAGNOSTICS_PERIOD, self._publish_diagnostics)
        # Triggered when the next update can be made, so that each is a callback of its own and others get a turn.
        self._next = self.create_guard_condition(self._advance)
        self._publish_parameters()
        self._publish_status()

    def _on_timer(self) -> None:
        """Say that this node lives."""
        self._publish_status()

    def _drop(self, what: str, error: RefusedMessageError) -> None:
        self._drops[error.reason] += 1
        if error.reason in HARMLESS:
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
        metrics = self.session.step()
        seconds = time.perf_counter() - start
        self._metrics = {"iteration_seconds": seconds, **norms(self.session.parameters), **metrics}
        self._publish_parameters()
        self._continue()
        if self.session.finished:
            self.get_logger().info(f"{self.own_name}: all {self._experiment.iterations} demonstrations learned")

    def _now(self) -> int:
        return self.get_clock().now().nanoseconds

    def _parameters_message(self, iteration: int, parameters: Parameters) -> ParametersMessage:
        return parameters_message(
            self.own_name, iteration, parameters, self._experiment_digest, self._schedule.digest, self._now()
        )

    def _publish_parameters(self) -> None:
        message = self._parameters_message(self.session.iteration, self.session.parameters)
        self._parameter_publisher.publish(message)

    def _publish_status(self) -> None:
        session = self.session
        message = LearnerStatus(
            learner=self.own_name,
            game_digest=self._game.digest,
            experiment_digest=self._experiment_digest,
            schedule_digest=self._schedule.digest,
            state=self._state(),
            iteration=session.iteration,
            last_demonstration=min(session.iteration - 1, self._experiment.iterations),
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

    def _publish_diagnostics(self) -> None:
        """Once a second: where this node stands, and a warning where it stands still."""
        stalled, self._diagnosed_at = self._diagnosed_at == self.session.iteration, self.session.iteration
        message = diagnostic_message(
            self.own_name, self.session, self._drops, time_message(self._now()), stalled=stalled
        )
        self._diagnostics_publisher.publish(message)

    def _state(self) -> int:
        if self.session.finished:
            return LearnerStatus.FINISHED
        if self.session.missing_demonstration:
            return LearnerStatus.WAITING_FOR_DEMONSTRATION
        return LearnerStatus.WAITING_FOR_NEIGHBOURS if self.session.waiting_for() else LearnerStatus.LEARNING
