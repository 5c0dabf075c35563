"""A node that finds the learners of a domain and shows what they publish."""

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from mabirds_msgs.msg import Constraints, EdgeSchedule, LearnerStatus, Parameters
from rcl_interfaces.srv import GetParameters
from rclpy.client import Client

from mabirds_bringup.watch.live_table import STATES
from mabirds_core.errors import MabirdsError, RefusedMessageError
from mabirds_core.experiment.assembly import build_game, method_names
from mabirds_core.experiment.file import load_experiment
from mabirds_core.metrics.metrics import norms
from mabirds_msgs_py import topics
from mabirds_msgs_py.constraints_conversion import read_constraints
from mabirds_msgs_py.conversion import arrays, read_schedule
from mabirds_msgs_py.interfaces import type_name
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.qos import STATUS_QOS, latched

SEARCH_PERIOD = 0.2
"""Seconds between two looks at the ROS graph."""

MAX_PATH = 1000
"""Characters of the path that a learner names; no file is looked for under a longer one."""

READABLE: dict[type, Callable[[Any], object]] = {
    LearnerStatus: lambda _: None,
    Parameters: arrays,
    Constraints: read_constraints,
    EdgeSchedule: read_schedule,
}
"""What raises RefusedMessageError for a message that cannot be shown."""


@dataclass
class WatchedLearner:
    """What is known of one learner, by its namespace; ``refused`` counts messages that cannot be shown, by reason."""

    namespace: str
    refused: Counter[str] = field(default_factory=Counter)
    status: LearnerStatus | None = None
    parameters: Parameters | None = None
    schedule: EdgeSchedule | None = None
    constraints: Constraints | None = None
    feature_names: tuple[str, ...] | None = None
    asked_for_names: bool = False
    answered: bool = False

    @property
    def complete(self) -> bool:
        """Has everything arrived that ``describe`` can show? Constraints come at the end, and not of every game."""
        return None not in (self.status, self.parameters, self.schedule) and self.answered


class InspectorNode(NetworkNode):
    """Calls ``on_parameters``, ``on_status`` and ``on_constraints`` with a learner at each of its messages.

    Names of cost features come from the learner's own experiment file, where it can be read here and has the digest
    that the learner publishes; elsewhere features are numbered.
    """

    def __init__(
        self,
        on_parameters: Callable[[WatchedLearner], None] = lambda _: None,
        on_status: Callable[[WatchedLearner], None] = lambda _: None,
        on_constraints: Callable[[WatchedLearner], None] = lambda _: None,
        **node_options: Any,
    ) -> None:
        super().__init__("inspector", **node_options)
        self.learners: dict[str, WatchedLearner] = {}
        self._on_parameters, self._on_status, self._on_constraints = on_parameters, on_status, on_constraints
        self._parameter_clients: dict[str, Client] = {}
        self.create_timer(SEARCH_PERIOD, self._search)

    @property
    def complete(self) -> bool:
        """Has every learner of the schedules been found and heard?"""
        return (
            bool(self.learners) and not self.missing() and all(learner.complete for learner in self.learners.values())
        )

    def missing(self) -> list[str]:
        """Learners that a schedule names and that were not found."""
        schedules = [learner.schedule for learner in self.learners.values() if learner.schedule is not None]
        named = {name for schedule in schedules for name in schedule.learners}
        return sorted(named - {topics.split_namespace(namespace)[1] for namespace in self.learners})

    def _search(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            namespace = topic.removesuffix(f"/{topics.STATUS}")
            if type_name(LearnerStatus) in types and namespace != topic and namespace not in self.learners:
                self._watch(namespace)
        for learner in self.learners.values():
            self._ask_for_names(learner)

    def _watch(self, namespace: str) -> None:
        learner = self.learners[namespace] = WatchedLearner(namespace)
        node = "baseline" if topics.split_namespace(namespace)[1] in method_names() else "learner"
        self._parameter_clients[namespace] = self.create_client(GetParameters, f"{namespace}/{node}/get_parameters")
        for message_type, topic, name, qos, tell in (
            (LearnerStatus, topics.STATUS, "status", STATUS_QOS, self._on_status),
            (Parameters, topics.PARAMETERS, "parameters", latched(64), self._on_parameters),
            (EdgeSchedule, topics.EDGE_SCHEDULE, "schedule", STATUS_QOS, lambda _: None),
            (Constraints, topics.CONSTRAINTS, "constraints", STATUS_QOS, self._on_constraints),
        ):
            receive = partial(self._on_message, learner, name, tell)
            self.create_subscription(message_type, f"{namespace}/{topic}", receive, qos)

    def _on_message(
        self, learner: WatchedLearner, name: str, tell: Callable[[WatchedLearner], None], message: Any
    ) -> None:
        try:
            READABLE[type(message)](message)
        except RefusedMessageError as error:
            learner.refused[error.reason] += 1
            return
        setattr(learner, name, message)
        tell(learner)

    def _ask_for_names(self, learner: WatchedLearner) -> None:
        client = self._parameter_clients[learner.namespace]
        if not learner.asked_for_names and learner.parameters is not None and client.service_is_ready():
            learner.asked_for_names = True
            request = GetParameters.Request(names=["experiment", "run"])
            client.call_async(request).add_done_callback(partial(self._on_experiment, learner))

    def _on_experiment(self, learner: WatchedLearner, future: Any) -> None:
        learner.answered = True
        values = [value.string_value for value in future.result().values]
        if len(values) != 2 or len(values[0]) > MAX_PATH or not Path(values[0]).is_file():
            return  # of another host: features stay numbered
        file, run = values
        try:
            experiment = load_experiment(Path(file))
        except MabirdsError:
            return
        if learner.parameters is not None and experiment.run_digest(run) == learner.parameters.experiment_digest:
            learner.feature_names = build_game(experiment).cost_features.names


def describe(learner: WatchedLearner, top: int) -> dict[str, Any]:
    """Everything about a learner as plain values; ``top``: how many of the costliest features."""
    content: dict[str, Any] = {"namespace": learner.namespace}
    if learner.status is not None:
        status = learner.status
        content |= {
            "state": STATES.get(status.state, f"unknown state {status.state}"),
            "iteration": status.iteration,
            "waiting_for": list(status.waiting_for),
            "backlog": status.backlog,
            "last_demonstration": status.last_demonstration,
            "mixed_from": list(status.mixed_from),
            "metrics": dict(zip(status.metric_names, map(_number, status.metric_values), strict=False)),
            "dropped": dict(zip(status.drop_reasons, map(int, status.drop_counts), strict=False)),
            "message": status.message,
        }
    if learner.refused:
        content["refused"] = dict(learner.refused)
    if learner.parameters is not None:
        content["parameters"] = describe_parameters(learner, top)
    if learner.constraints is not None:
        message = learner.constraints
        content["constraints"] = {
            "iteration": message.iteration,
            "level": message.level,
            "undetermined": message.undetermined,
            "by_name": read_constraints(message),
        }
    return content


def describe_parameters(learner: WatchedLearner, top: int) -> dict[str, Any]:
    """Iteration, norms and the costliest features of the newest parameters."""
    parameters = arrays(learner.parameters)
    order = np.argsort(parameters.omega, kind="stable")[:top]
    return {
        "iteration": learner.parameters.iteration if learner.parameters else None,
        **norms(parameters),
        "costliest": [{"feature": _name(learner, int(k)), "cost": float(0.0 - parameters.omega[k])} for k in order],
    }


def _name(learner: WatchedLearner, feature: int) -> str:
    names = learner.feature_names or ()
    return names[feature] if feature < len(names) else f"feature {feature}"


def _number(value: float) -> float | None:
    """The number as JSON knows it: NaN and infinity are no numbers there."""
    return value if math.isfinite(value) else None
