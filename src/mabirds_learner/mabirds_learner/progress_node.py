"""What learner and baseline nodes share: one update after the other, each published with where the node stands."""

import time
from array import array
from collections import Counter
from functools import partial
from typing import Any

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray
from mabirds_msgs.msg import EdgeSchedule, FeatureNames, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import ExperimentError, RefusedMessageError
from mabirds_core.experiment.differences import settings_lines
from mabirds_core.experiment.names import parameter_names
from mabirds_core.games.whole_game import Game
from mabirds_core.metrics.metrics import norms
from mabirds_learner.diagnostics import HARMLESS, learning_diagnostic
from mabirds_learner.progress import Session
from mabirds_msgs_py import diagnostics, topics
from mabirds_msgs_py.conversion import floats, parameters_message, schedule_message, time_message
from mabirds_msgs_py.feature_names_conversion import feature_names_message
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.qos import STATUS_QOS, announced, latched
from mabirds_msgs_py.ros_parameters import declare_experiment, experiment_of, float_param, int_param
from mabirds_msgs_py.security import is_requested
from mabirds_msgs_py.settings_inquiry import declare_settings

STATUSES_AN_ITERATION = 8
"""No more than these, as a rule: one for the update; where it is slow one for each arrival and second in between."""

QUIET = 0.05
"""Seconds after a status in which arrivals are not told: where learning is fast, each update is told once."""

TURN = 0.01
"""Seconds for which updates are made one after the other before others get a turn."""


class ProgressNode(NetworkNode):
    """A node that learns: its name is its namespace.

    A subclass creates ``session`` and its inputs, and then calls ``start``.

    Parameters
    ----------
    kind : str
        Of the node: its name, below the namespace.
    **node_options : Any
        Of ``rclpy.node.Node``.

    Raises
    ------
    MabirdsError
        The experiment is wrong, or there is no namespace.
    """

    session: Session

    def __init__(self, kind: str, **node_options: Any) -> None:
        super().__init__(kind, **node_options)
        declare_experiment(self)
        self.declare_parameter(
            "demonstration_history", 256, int_param("demonstrations kept ahead of the current iteration", 256, 100_000)
        )
        self.declare_parameter(
            "status_period", 1.0, float_param("seconds between two status messages while nothing changes", 0.05, 60.0)
        )
        self.namespace_prefix, self.learner_name = topics.split_namespace(self.get_namespace())
        if not self.learner_name:
            raise ExperimentError("no namespace: a learner's namespace is its name; start with -r __ns:=/learner_1")
        self.experiment, self.experiment_digest = experiment_of(self)
        self.schedule = self.experiment.edge_schedule
        run, secured = self.get_param("run"), is_requested([])
        declare_settings(self, settings_lines(self.experiment, run))
        self.service_name = partial(topics.of_run, run=run, digest=self.experiment_digest, secured=secured)
        self._drops: Counter[str] = Counter()
        self._event, self._told_at = "", 0.0
        self._update_seconds, self._prepare_seconds = QUIET, 0.0

    def get_param(self, name: str) -> Any:
        """The value of a ROS parameter."""
        return self.get_parameter(name).value

    def start(self, game: Game, history: int) -> None:
        """Announce theta(1), omega(1) and the status.

        Parameters
        ----------
        game : Game
            Of the experiment.
        history : int
            Messages kept for those who come late.
        """
        self.game = game
        self._metrics = norms(self.session.parameters)
        self._status = LearnerStatus(
            learner=self.learner_name,
            game_digest=game.digest,
            experiment_digest=self.experiment_digest,
            schedule_digest=self.schedule.digest,
        )
        self._outgoing = self.parameters_message(self.session.iteration, self.session.parameters)
        self._parameter_publisher = self.create_publisher(ParametersMessage, topics.PARAMETERS, announced(history))
        # Deeper, so that a recorder gets every status; readers that want the newest only ask for a depth of 1.
        depth = STATUSES_AN_ITERATION * history
        self._status_publisher = self.create_publisher(LearnerStatus, topics.STATUS, latched(depth))
        self._schedule_publisher = self.create_publisher(EdgeSchedule, topics.EDGE_SCHEDULE, STATUS_QOS)
        self._schedule_publisher.publish(schedule_message(self.schedule))
        self._names_publisher = self.create_publisher(FeatureNames, topics.FEATURE_NAMES, STATUS_QOS)
        self._publish_names()
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, diagnostics.DEPTH)
        self._diagnosed_at = 0
        self.create_timer(self.get_param("status_period"), self.on_timer)
        self.create_timer(diagnostics.PERIOD, self._publish_diagnostics)
        self._next = self.create_guard_condition(self.go_on)
        self.publish_history()
        self.publish_status()

    def _publish_names(self) -> None:
        """Once, for all who ever listen: what theta and omega speak of."""
        message = feature_names_message(parameter_names(self.experiment, self.learner_name, self.game))
        message.stamp, message.learner, message.experiment_digest = (
            self.stamp(),
            self.learner_name,
            self.experiment_digest,
        )
        self._names_publisher.publish(message)

    def on_timer(self) -> None:
        """Say that this node lives."""
        self.publish_status()

    def set_event(self, words: str, *, log: bool = True) -> None:
        """Tell people, in the statuses from now on.

        Parameters
        ----------
        words : str
            A sentence.
        log : bool, optional
            Tell it in the log, too.
        """
        self._event = words
        if log:
            self.get_logger().info(words)

    def reject(self, what: str, error: RefusedMessageError) -> None:
        """Count a message that is not used, and say why unless that is harmless.

        The next regular status tells of it: a flood of such messages must not become a flood of statuses.

        Parameters
        ----------
        what : str
            Which message it is.
        error : RefusedMessageError
            Why.
        """
        if error.reason in HARMLESS:
            self._drops[error.reason] += 1
        else:
            self.count_drop(error.reason, f"dropped {what}: {error}")

    def count_drop(self, reason: str, words: str) -> None:
        """Count a message that is not used; into the log only once for each reason, so that nobody can flood it.

        Parameters
        ----------
        reason : str
            A short name to count by.
        words : str
            For people.
        """
        self._drops[reason] += 1
        self._event = words
        if self._drops[reason] == 1:
            self.get_logger().warning(words)

    def go_on(self) -> None:
        """Something has arrived: make the updates for which everything is there, and tell of it.

        Of the next one the part that needs nobody else follows at once, while what neighbours send is under way.
        """
        begun, session = time.monotonic(), self.session
        if begun - self._told_at >= QUIET or (self._update_seconds >= QUIET and (session.ready or session.can_prepare)):
            self.publish_status()
        while session.ready or session.can_prepare:
            if time.monotonic() - begun > TURN:
                self._next.trigger()
                return
            (self._update if session.ready else self._prepare)()

    def _prepare(self) -> None:
        start = time.perf_counter()
        self.session.prepare()
        self._prepare_seconds = time.perf_counter() - start

    def _update(self) -> None:
        start = time.perf_counter()
        metrics = self.session.step()
        self._update_seconds = self._prepare_seconds + time.perf_counter() - start
        self._prepare_seconds = 0.0
        self._metrics = {"iteration_seconds": self._update_seconds, **norms(self.session.parameters), **metrics}
        self.save()
        self.publish_update()
        self.publish_status()
        if self.session.finished:
            self.get_logger().info(f"{self.learner_name}: all {self.experiment.iterations} demonstrations learned")

    def save(self) -> None:
        """Remember what the update led to, before it is published."""

    def publish_update(self) -> None:
        """Tell what the update led to."""
        self.publish_parameters(self.session.iteration, self.session.parameters)

    def publish_history(self) -> None:
        """Tell those who listen now where this node begins."""
        self.publish_parameters(self.session.iteration, self.session.parameters)

    def _now(self) -> int:
        return time.time_ns()  # as the node's clock, which use_sim_time cannot change here, but ten times as fast

    def stamp(self) -> Time:
        """The present time for a message."""
        return time_message(self._now())

    def parameters_message(self, iteration: int, parameters: Parameters) -> ParametersMessage:
        """Write parameters of this node.

        Parameters
        ----------
        iteration : int
            n.
        parameters : Parameters
            theta(n), omega(n).

        Returns
        -------
        ParametersMessage
            Stamped with the present time.
        """
        return parameters_message(
            self.learner_name, iteration, parameters, self.experiment_digest, self.schedule.digest, self._now()
        )

    def publish_parameters(self, iteration: int, parameters: Parameters) -> None:
        """Tell everybody who listens.

        Parameters
        ----------
        iteration : int
            n.
        parameters : Parameters
            theta(n), omega(n).
        """
        message = self._outgoing  # to fill it takes half as long as to make another
        message.stamp, message.iteration = self.stamp(), iteration
        message.theta, message.omega = floats(parameters.theta), floats(parameters.omega)
        self._parameter_publisher.publish(message)

    def publish_status(self) -> None:
        """Tell where this node stands."""
        session, status, self._told_at = self.session, self._status, time.monotonic()
        iteration, waiting_for = session.iteration, session.waiting_for()
        status.state, status.epoch, status.iteration = self._state(waiting_for), session.epoch, iteration
        status.last_demonstration = min(iteration - 1, self.experiment.iterations)
        status.backlog, status.waiting_for, status.mixed_from = session.backlog, waiting_for, session.mixed_from
        status.metric_names, status.metric_values = list(self._metrics), array("d", self._metrics.values())
        status.drop_reasons, status.drop_counts = list(self._drops), array("I", self._drops.values())
        status.message, status.stamp = self._event, self.stamp()
        self._status_publisher.publish(status)

    def _publish_diagnostics(self) -> None:
        """Once a second: where this node stands, and a warning where it stands still."""
        stalled, self._diagnosed_at = self._diagnosed_at == self.session.iteration, self.session.iteration
        message = learning_diagnostic(
            self.learner_name, self.session, self._drops, self._metrics, self.stamp(), stalled=stalled
        )
        self._diagnostics_publisher.publish(message)

    def _state(self, waiting_for: list[str]) -> int:
        if self.session.finished:
            return LearnerStatus.FINISHED
        if self.session.missing_demonstration:
            return LearnerStatus.WAITING_FOR_DEMONSTRATION
        return LearnerStatus.WAITING_FOR_NEIGHBOURS if waiting_for else LearnerStatus.LEARNING
