"""A node that watches learners: their statuses and parameters, never their demonstrations."""

from collections import Counter
from collections.abc import Callable, Collection, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Protocol

from mabirds_msgs.msg import Constraints, EdgeSchedule, FeatureNames, LearnerStatus, Membership, PlayerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from mabirds_msgs.srv import FetchParameters
from rclpy.client import Client
from rclpy.serialization import deserialize_message

from mabirds_bringup.watch.admission import EXPECTED, MessageValidator
from mabirds_bringup.watch.watched_history import WatchedHistory
from mabirds_core.consensus.schedule import DeliveredEdges
from mabirds_core.errors import CheckpointError, RefusedMessageError
from mabirds_core.experiment.differences import settings_lines
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History
from mabirds_core.metrics.metrics import consensus_distance
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import nanoseconds
from mabirds_msgs_py.mass_conversion import membership_message, read_membership
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.player_services import STATUS
from mabirds_msgs_py.presence import LivelinessMonitor
from mabirds_msgs_py.qos import STATUS_QOS, announced, latched
from mabirds_msgs_py.security import is_requested
from mabirds_msgs_py.settings_inquiry import SettingsInquiry

DEPTH = 10_000
"""The monitor must not lose what learners publish while it draws; writers keep less, so this costs nothing."""


PLAYER_STATUS = f"expert_player/{STATUS}"
"""Where the player of `mabirds run` says how it stands."""

OTHER_EXPERIMENT = ("wrong_experiment", "wrong_schedule")
"""Reasons for which what learners of an experiment's names say is refused where it is another one."""

GAP_PERIOD, GAPS_AT_ONCE = 0.5, 32
"""Seconds between two looks at what was missed, and how much of it is asked for in one."""


class Recorder(Protocol):
    """What messages are recorded to."""

    def write(self, topic: str, message: Any, time: int, data: bytes | None = None, /) -> None:
        """Append a message of ``topic``; ``time`` in nanoseconds, ``data``: its bytes, where they are at hand."""
        ...


class MonitorNode(NetworkNode):
    """Collects theta(n), omega(n) and the newest status of every learner of an experiment, and records all to a bag.

    ``names``: who learns, where it is not the experiment's learners. ``directory``: of the files of ``kept``, which a
    run that goes on begins with; None: of no use afterwards. ``parameters[name][n]``, ``statuses[name]``; ``player``:
    its newest status; ``presence``: whose process is gone. ``lost``: by name, iterations that were missed and that
    nobody keeps any more.
    ``key``: of its declarations.
    Messages of other runs, and what no learner of the experiment can say, are neither shown nor recorded; ``drops``
    counts them by reason, and ``refusals`` says why, of the newest for each reason.
    """

    def __init__(
        self,
        experiment: Experiment,
        recording: Recorder,
        run: str = "",
        names: Sequence[str] | None = None,
        directory: Path | None = None,
        key: bytes = b"",
        **node_options: Any,
    ) -> None:
        super().__init__("monitor", **node_options)
        self._experiment, self._recording, self._key = experiment, recording, key
        self.names = tuple(names or experiment.learners)
        self._admission = MessageValidator(experiment, run, self.names)
        self.drops: Counter[str] = Counter()
        self.refusals: dict[str, str] = {}
        self._inquiry = SettingsInquiry(self, settings_lines(experiment, run))
        self._different: set[str] = set()
        self.kept = WatchedHistory(directory, self._admission.initial, experiment.learners, self._admission.digest)
        self.parameters = self.kept.parameters
        self.statuses: dict[str, LearnerStatus] = {}
        self.player: PlayerStatus | None = None
        self.presence = LivelinessMonitor()
        self.lost: dict[str, set[int]] = {name: set() for name in self.names}
        self._fetch: dict[str, Client] = {}
        self._declared: set[str] = set()
        self._members: dict[int, list[str]] = {}
        self.digest, secured = self._admission.digest, is_requested([])
        self._service = topics.of_run(topics.FETCH_PARAMETERS, run, self.digest, secured=secured)
        if experiment.mixing.declares_members:
            self._membership_publisher = self.create_publisher(Membership, topics.MEMBERSHIP, latched(1))
            self.create_subscription(Membership, topics.MEMBERSHIP, self._on_membership, latched(DEPTH))
        for name in self.names:
            self._watch(name)
        self.create_subscription(PlayerStatus, PLAYER_STATUS, self._on_player, STATUS_QOS)
        self.create_timer(GAP_PERIOD, self._ask_for_gaps)

    def destroy_node(self) -> None:
        """Close the history with the node."""
        self.kept.close()
        super().destroy_node()

    def _watch(self, name: str) -> None:
        for message_type, topic, qos, receive, events in (
            (ParametersMessage, topics.PARAMETERS, announced(DEPTH), self._on_parameters, self.presence.watch(name)),
            (LearnerStatus, topics.STATUS, latched(DEPTH), self._on_status, None),
            (Constraints, topics.CONSTRAINTS, STATUS_QOS, self._on_constraints, None),
            (EdgeSchedule, topics.EDGE_SCHEDULE, STATUS_QOS, self._on_schedule, None),
            (FeatureNames, topics.FEATURE_NAMES, STATUS_QOS, self._on_feature_names, None),
        ):
            receive_bytes = partial(self._read, message_type, partial(receive, name))
            self.create_subscription(
                message_type, f"{name}/{topic}", receive_bytes, qos, event_callbacks=events, raw=True
            )
        self._fetch[name] = self.create_client(FetchParameters, f"{name}/{self._service}")

    def _read(self, message_type: type, receive: Callable[..., None], data: bytes) -> None:
        """Bytes are recorded as they came: writing messages anew would take as long as reading them."""
        receive(deserialize_message(data, message_type), data)

    def declare_without(self, departed: Collection[str]) -> None:
        """Declare, once, that the network goes on without those."""
        if set(departed) <= self._declared:
            return
        self._declared.update(departed)
        members = [name for name in self.taking_part() if name not in self._declared]
        message = membership_message(self._admission.digest, self._epoch() + 1, members, self._key)
        message.stamp = self.get_clock().now().to_msg()
        self._membership_publisher.publish(message)

    def _epoch(self) -> int:
        return max((status.epoch for status in self.statuses.values()), default=0)

    def taking_part(self) -> list[str]:
        """Whom the newest declaration that learners follow names; all, where there was none.

        Where it was made before this node was there: those whose status says that they follow it.
        """
        epoch = self._epoch()
        if epoch <= 1:
            return list(self.names)
        members = self._members.get(epoch) or [name for name in self.names if self._follows(name, epoch)]
        return [name for name in members if name not in self._declared and not self.has_departed(name)]

    def _follows(self, name: str, epoch: int) -> bool:
        return name in self.statuses and self.statuses[name].epoch == epoch

    def has_departed(self, name: str) -> bool:
        """Has a declaration left it out? Then it says that it has finished, before its time."""
        status = self.statuses.get(name)
        if status is None or status.epoch <= 1:
            return False
        return bool(status.state == LearnerStatus.FINISHED and status.iteration < self._admission.last)

    def _missing(self, name: str) -> list[int]:
        """Iterations before the newest that were not heard of and may still be had."""
        received, status = self.parameters[name], self.statuses.get(name)
        newest = received.newest
        if status is not None and status.state == LearnerStatus.FINISHED:
            newest = max(newest, status.iteration)
        return [n for n in received.gaps(newest) if n not in self.lost[name]]

    def _ask_for_gaps(self) -> None:
        """Ask learners for what they published before this node found them, or just before they died."""
        for name, client in self._fetch.items():
            for iteration in self._missing(name)[:GAPS_AT_ONCE] if client.service_is_ready() else ():
                future = client.call_async(FetchParameters.Request(iteration=iteration))
                future.add_done_callback(partial(self._on_fetched, name, iteration))

    def _on_fetched(self, name: str, iteration: int, future: Any) -> None:
        response = future.result()
        if response is None:
            return
        if response.found:
            self._on_parameters(name, response.parameters)
        else:
            self.lost[name].add(iteration)

    def _on_parameters(self, name: str, message: ParametersMessage, data: bytes | None = None) -> None:
        try:
            parameters = self._admission.parameters(name, message, self.parameters[name])
        except RefusedMessageError as error:
            self._drop(f"{topics.PARAMETERS} of {name}", error)
            return
        try:
            self.parameters[name][message.iteration] = parameters
        except CheckpointError as error:  # asked for again, and there may be room by then
            self._drop(f"{topics.PARAMETERS} of {name}", RefusedMessageError("unsaved", str(error)))
            return
        self._record(name, topics.PARAMETERS, message, nanoseconds(message.stamp), data)

    def _on_status(self, name: str, message: LearnerStatus, data: bytes | None = None) -> None:
        try:
            self._admission.status(name, message)
        except RefusedMessageError as error:
            self._drop(f"{topics.STATUS} of {name}", error)
            if error.reason in OTHER_EXPERIMENT:
                self._different.add(name)
                self.differences()
            return
        self.statuses[name] = message
        if message.iteration > 1:
            self.kept.note_mixed(name, message.iteration - 1, message.mixed_from)
        self._record(name, topics.STATUS, message, nanoseconds(message.stamp), data)

    def differences(self) -> str:
        """In words, which settings learners of other experiments have otherwise, as far as they have told."""
        kind = "learner" if set(self.names) <= set(self._experiment.learners) else "baseline"
        told = {name: self._inquiry.words(name, kind) for name in sorted(self._different)}
        return ". ".join(f"{name}: {words}" for name, words in told.items() if words)

    def _on_membership(self, message: Membership) -> None:
        try:
            members = read_membership(message, self._admission.digest, self._key)
        except RefusedMessageError as error:
            self._drop(topics.MEMBERSHIP, error)
            return
        self._members[message.epoch] = [name for name in self.names if name in members]

    def _on_constraints(self, name: str, message: Constraints, data: bytes | None = None) -> None:
        try:
            self._admission.constraints(name, message)
        except RefusedMessageError as error:
            self._drop(f"{topics.CONSTRAINTS} of {name}", error)
            return
        self._record(name, topics.CONSTRAINTS, message, nanoseconds(message.stamp), data)

    def _on_player(self, message: PlayerStatus) -> None:
        if message.experiment_digest == self.digest:
            self.player = message

    def _on_feature_names(self, name: str, message: FeatureNames, data: bytes | None = None) -> None:
        try:
            self._admission.feature_names(name, message)
        except RefusedMessageError as error:
            self._drop(f"{topics.FEATURE_NAMES} of {name}", error)
            return
        self._record(name, topics.FEATURE_NAMES, message, nanoseconds(message.stamp), data)

    def _on_schedule(self, name: str, message: EdgeSchedule, data: bytes | None = None) -> None:
        try:
            self._admission.schedule(message)
        except RefusedMessageError as error:
            self._drop(f"{topics.EDGE_SCHEDULE} of {name}", error)
            return
        self._record(name, topics.EDGE_SCHEDULE, message, self.get_clock().now().nanoseconds, data)

    def _drop(self, what: str, error: RefusedMessageError) -> None:
        self.drops[error.reason] += 1
        self.refusals[error.reason] = f"{what}: {error}"
        if self.drops[error.reason] == 1 and error.reason not in EXPECTED:
            self.get_logger().warning(f"dropped {what}: {error}")

    def _record(self, name: str, topic: str, message: Any, time: int, data: bytes | None) -> None:
        self._recording.write(f"/{name}/{topic}", message, max(0, time), data)  # the time may be the sender's: anything

    @property
    def all_learned(self) -> bool:
        """Has every learner acknowledged its last demonstration?"""
        last = self._experiment.iterations
        return all(
            name in self.statuses and self.statuses[name].last_demonstration >= last for name in self.taking_part()
        )

    @property
    def finished(self) -> bool:
        """Has every learner made all updates and closing rounds, and has the result of the last one arrived?

        Of whom nothing is heard in this life, what an earlier one wrote down counts.
        """
        last = self._admission.last
        names = self.taking_part()
        return (
            bool(names)
            and all(last in self.parameters[name] and not self._missing(name) for name in names)
            and all(self._has_finished(name) for name in names)
        )

    def _has_finished(self, name: str) -> bool:
        if name in self.statuses:
            return bool(self.statuses[name].state == LearnerStatus.FINISHED)
        return self.kept.knows_mixed(name, self._admission.last - 1)

    def consensus(self) -> tuple[int, float, float] | None:
        """(n, distance in theta, distance in omega) at the newest iteration known of all learners."""
        common = self.kept.newest_common()
        if not common:
            return None
        newest = [by_iteration[common] for by_iteration in self.parameters.values()]
        return (
            common,
            consensus_distance([parameters.theta for parameters in newest]),
            consensus_distance([parameters.omega for parameters in newest]),
        )

    def mass_residual(self) -> float | None:
        """How far the weight that learners hold, and that is under way between them, is from what they began with.

        Rounding apart 0, whatever was lost. None in strict mode, and where the newest statuses are of several epochs.
        """
        statuses = self.statuses.values()
        metrics = [dict(zip(status.metric_names, status.metric_values, strict=False)) for status in statuses]
        if not all("weight" in shown for shown in metrics) or len({status.epoch for status in statuses}) > 1:
            return None
        signs = {"weight": 1, "weight_sent": 1, "weight_received": -1, "initial_weight": -1}
        return sum(signs.get(name.split(".")[0], 0) * value for shown in metrics for name, value in shown.items())

    def delivered(self) -> DeliveredEdges:
        """Whose parameters each learner says it mixed, at the iterations of which all learners' statuses were heard."""
        return self.kept.delivered()

    def history(self) -> History:
        """theta(n), omega(n) from n = 1 up to the newest without a gap."""
        return self.kept.without_gap()
