"""A node that finds the learners and players of a domain and keeps the newest that each of them says."""

import time
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any

from mabirds_msgs.msg import Constraints, EdgeSchedule, FeatureNames, LearnerStatus, Parameters, PlayerStatus

from mabirds_core.consensus.schedule import EdgeSchedule as Schedule
from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.names import ParameterNames
from mabirds_msgs_py import player_services, topics
from mabirds_msgs_py.constraints_conversion import read_constraints
from mabirds_msgs_py.conversion import arrays, read_schedule
from mabirds_msgs_py.feature_names_conversion import read_feature_names
from mabirds_msgs_py.interfaces import type_name
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.qos import STATUS_QOS, latched

SEARCH_PERIOD = 0.2
"""Seconds between two looks at the ROS graph."""

BURST, SILENCE = 0.5, 2.0
"""Seconds for which latched messages may keep coming, and of silence after which no more are to be expected."""

NEWEST = 4
"""Iterations of parameters that wait to be looked at: of two learners some are the same."""

RATED, RATED_FOR = 500, 1.0
"""Newest statuses of which the rate is told, and seconds that they must cover: two that happen to come together say
nothing.
"""

READABLE: dict[type, Callable[[Any], object]] = {
    LearnerStatus: lambda _: None,
    Parameters: arrays,
    Constraints: read_constraints,
    EdgeSchedule: read_schedule,
    FeatureNames: read_feature_names,
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
    feature_names: FeatureNames | None = None
    first_heard: float | None = None
    last_heard: float = 0.0
    progress: deque[tuple[float, int]] = field(default_factory=lambda: deque(maxlen=RATED))

    @property
    def name(self) -> str:
        """Its name, which is the last part of its namespace."""
        return topics.split_namespace(self.namespace)[1]

    def note_status(self, now: float) -> None:
        """A status has come: when, and at which iteration."""
        if self.first_heard is None:
            self.first_heard = now
        self.last_heard = now
        self.progress.append((now, self.status.iteration if self.status else 0))

    def is_newest(self, now: float) -> bool:
        """Is the status one of now, not one of those that a publisher keeps for late joiners?

        They come in order and at once, so one that comes later is new. A learner in a long update says nothing.
        """
        if self.first_heard is None:
            return False
        return self.last_heard - self.first_heard >= BURST or now - self.last_heard >= SILENCE

    def is_complete(self, now: float) -> bool:
        """Has the newest of everything arrived? Constraints come at the end, and not of every game."""
        if self.status is None or self.parameters is None or self.schedule is None or self.feature_names is None:
            return False
        return self.parameters.iteration >= self.status.iteration and self.is_newest(now)

    @property
    def rate(self) -> float | None:
        """Iterations per second, of the newest statuses; None before they cover RATED_FOR seconds."""
        if len(self.progress) < 2:
            return None
        (begun, first), (ended, last) = self.progress[0], self.progress[-1]
        return (last - first) / (ended - begun) if ended - begun >= RATED_FOR else None

    @property
    def names(self) -> ParameterNames:
        """Of theta and omega; empty as long as they have not been heard."""
        return read_feature_names(self.feature_names) if self.feature_names else ParameterNames((), ())

    @property
    def edges(self) -> Schedule | None:
        """The schedule that it follows, as it says."""
        return read_schedule(self.schedule) if self.schedule else None


class InspectorNode(NetworkNode):
    """Keeps the newest of every learner and player, and calls ``on_message`` with a learner and what has come of it.

    Names of features come from the learners, so that they are known on every host and to those who come late.
    """

    def __init__(
        self,
        on_message: Callable[[WatchedLearner, str], None] = lambda _, __: None,
        name: str = "inspector",
        **node_options: Any,
    ) -> None:
        super().__init__(name, **node_options)
        self.learners: dict[str, WatchedLearner] = {}
        self.players: dict[str, PlayerStatus | None] = {}
        self._on_message = on_message
        self.create_timer(SEARCH_PERIOD, self._search)

    @property
    def complete(self) -> bool:
        """Has every learner of the schedules been found, and its newest been heard?"""
        now = time.monotonic()
        learners = self.learners.values()
        return bool(learners) and not self.missing() and all(learner.is_complete(now) for learner in learners)

    def missing(self) -> list[str]:
        """Learners that a schedule names and that were not found."""
        schedules = [learner.schedule for learner in self.learners.values() if learner.schedule is not None]
        named = {name for schedule in schedules for name in schedule.learners}
        return sorted(named - {topics.split_namespace(namespace)[1] for namespace in self.learners})

    def _search(self) -> None:
        for topic, types in self.get_topic_names_and_types():
            namespace, _, last = topic.rpartition("/")
            if last == topics.STATUS and type_name(LearnerStatus) in types and namespace not in self.learners:
                self.watch(namespace)
            if last == player_services.STATUS and type_name(PlayerStatus) in types and topic not in self.players:
                self.players[topic] = None
                self.create_subscription(PlayerStatus, topic, partial(self.players.__setitem__, topic), STATUS_QOS)

    def watch(self, namespace: str) -> None:
        """Listen to all that the learner of a namespace says."""
        learner = self.learners[namespace] = WatchedLearner(namespace)
        for message_type, topic, name, qos in (
            (LearnerStatus, topics.STATUS, "status", STATUS_QOS),
            (Parameters, topics.PARAMETERS, "parameters", latched(NEWEST)),
            (EdgeSchedule, topics.EDGE_SCHEDULE, "schedule", STATUS_QOS),
            (Constraints, topics.CONSTRAINTS, "constraints", STATUS_QOS),
            (FeatureNames, topics.FEATURE_NAMES, "feature_names", STATUS_QOS),
        ):
            receive = partial(self._receive, learner, name)
            self.create_subscription(message_type, f"{namespace}/{topic}", receive, qos)

    def _receive(self, learner: WatchedLearner, name: str, message: Any) -> None:
        try:
            READABLE[type(message)](message)
        except RefusedMessageError as error:
            learner.refused[error.reason] += 1
            return
        setattr(learner, name, message)
        if name == "status":
            learner.note_status(time.monotonic())
        self._on_message(learner, name)
