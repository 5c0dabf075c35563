"""A node that watches learners: their statuses and parameters, never their demonstrations."""

from collections.abc import Sequence
from functools import partial
from itertools import count, takewhile
from typing import Any

from mabirds_msgs.msg import EdgeSchedule, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy.node import Node

from mabirds_core.experiment import Experiment
from mabirds_core.metrics import consensus_distance
from mabirds_core.parameters import Parameters
from mabirds_core.schedule import Delivered
from mabirds_core.simulate import History
from mabirds_msgs_py import topics
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.conversion import arrays, nanoseconds
from mabirds_msgs_py.qos import STATUS_QOS, latched

DEPTH = 10_000
"""The monitor must not lose what learners publish while it draws; writers keep less, so this costs nothing."""


class MonitorNode(Node):
    """Collects theta(n), omega(n) and the newest status of every learner of an experiment, and records all to a bag.

    ``names``: who learns, where it is not the experiment's learners. ``parameters[name][n]``, ``statuses[name]``.
    Messages of other runs are neither shown nor recorded.
    """

    def __init__(
        self,
        experiment: Experiment,
        recording: BagWriter,
        run: str = "",
        names: Sequence[str] | None = None,
        **node_options: Any,
    ) -> None:
        super().__init__("monitor", **node_options)
        self._experiment, self._digest = experiment, experiment.run_digest(run)
        self._recording = recording
        self.names = tuple(names or experiment.learners)
        self.parameters: dict[str, dict[int, Parameters]] = {name: {} for name in self.names}
        self.statuses: dict[str, LearnerStatus] = {}
        self._mixed: dict[str, dict[int, list[str]]] = {name: {} for name in self.names}
        for name in self.names:
            self._watch(name)

    def _watch(self, name: str) -> None:
        for message_type, topic, qos, receive in (
            (ParametersMessage, topics.PARAMETERS, latched(DEPTH), self._on_parameters),
            (LearnerStatus, topics.STATUS, latched(DEPTH), self._on_status),
            (EdgeSchedule, topics.EDGE_SCHEDULE, STATUS_QOS, self._on_schedule),
        ):
            self.create_subscription(message_type, f"{name}/{topic}", partial(receive, name), qos)

    def _on_parameters(self, name: str, message: ParametersMessage) -> None:
        if message.experiment_digest != self._digest:
            return
        self.parameters[name][message.iteration] = arrays(message)
        self._record(name, topics.PARAMETERS, message, nanoseconds(message.stamp))

    def _on_status(self, name: str, message: LearnerStatus) -> None:
        if message.experiment_digest != self._digest:
            return
        self.statuses[name] = message
        if message.iteration > 1:
            self._mixed[name][message.iteration - 1] = list(message.mixed_from)
        self._record(name, topics.STATUS, message, nanoseconds(message.stamp))

    def _on_schedule(self, name: str, message: EdgeSchedule) -> None:
        self._record(name, topics.EDGE_SCHEDULE, message, self.get_clock().now().nanoseconds)

    def _record(self, name: str, topic: str, message: Any, time: int) -> None:
        self._recording.write(f"/{name}/{topic}", message, time)

    @property
    def all_learned(self) -> bool:
        """Has every learner acknowledged its last demonstration?"""
        last = self._experiment.iterations
        return all(name in self.statuses and self.statuses[name].last_demonstration >= last for name in self.parameters)

    @property
    def finished(self) -> bool:
        """Has every learner made all updates and closing rounds, and has the result of the last one arrived?"""
        closing = self._experiment.closing_rounds if self.names == self._experiment.learners else 0
        last = self._experiment.iterations + closing + 1
        return all(last in known for known in self.parameters.values()) and all(
            name in self.statuses and self.statuses[name].state == LearnerStatus.FINISHED for name in self.names
        )

    def consensus(self) -> tuple[int, float, float] | None:
        """(n, distance in theta, distance in omega) at the newest iteration known of all learners."""
        common = set.intersection(*(set(known) for known in self.parameters.values()))
        if not common:
            return None
        newest = [known[max(common)] for known in self.parameters.values()]
        return (
            max(common),
            consensus_distance([one.theta for one in newest]),
            consensus_distance([one.omega for one in newest]),
        )

    def delivered(self) -> Delivered:
        """Whose parameters each learner says it mixed, at the iterations of which all learners' statuses were heard."""
        heard = set.intersection(*(set(known) for known in self._mixed.values()))
        return {n: [self._mixed[name][n] for name in self.names] for n in sorted(heard)}

    def history(self) -> History:
        """theta(n), omega(n) from n = 1 up to the newest without a gap."""
        return {
            name: [known[n] for n in takewhile(known.__contains__, count(1))] for name, known in self.parameters.items()
        }
