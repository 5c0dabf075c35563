"""The expert player: streams each learner's recorded demonstrations to that learner alone.

``rate`` multiplies the recorded timing; ``hz`` above 0 overrides it with demonstrations per second. Both may change
while the node runs. Nothing is sent before a learner has announced itself with the right game, and never more than
``max_in_flight`` demonstrations beyond what it has learned.
"""

import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from mabirds_msgs.msg import Demonstration, LearnerStatus
from mabirds_msgs.srv import PlayNext, Resend
from rclpy.parameter import Parameter
from std_srvs.srv import SetBool

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, method_names
from mabirds_core.texts import truncate
from mabirds_expert_player.diagnostics import playing_diagnostic
from mabirds_expert_player.stream import AckFilter, Stream
from mabirds_msgs_py import diagnostics, topics
from mabirds_msgs_py.bag_digest import open_bag
from mabirds_msgs_py.conversion import NANOSECONDS, time_message
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.node_main import run_node
from mabirds_msgs_py.qos import latched
from mabirds_msgs_py.ros_parameters import declare_experiment, experiment_of, float_param, int_param, str_param

PATIENCE = 2.0
"""Seconds after which a demonstration that a waiting learner does not acknowledge is sent again.

And until statuses that contradict each other are believed to be a learner's or a player's new start."""

IDLE = 3600.0
"""Seconds between two looks while nothing can become due by itself."""

STATUS_DEPTH = 10
"""Statuses of a learner that wait to be read; one would be hidden by those of a namesake in another run."""

HISTORY = 256
"""Depth of the demonstration topics: what a late joiner still gets."""


class ExpertPlayerNode(NetworkNode):
    """Plays an experiment's bag. ``done`` turns true once every learner has learned everything.

    Parameters
    ----------
    **node_options : Any
        Of ``rclpy.node.Node``.

    Raises
    ------
    MabirdsError
        The experiment or the bag is wrong.
    """

    def __init__(self, **node_options: Any) -> None:
        super().__init__("expert_player", **node_options)
        self._declare_parameters()
        experiment, self._experiment_digest = experiment_of(self)
        self._schedule_digest = experiment.edge_schedule.digest
        if self._value("baseline") not in ("", *method_names()):
            raise ExperimentError(f"baseline {self._value('baseline')!r}: expected one of {method_names()}, or nothing")
        self._game = build_game(experiment)
        directory = Path(self._value("bag") or experiment.demonstrations.bag)
        self.get_logger().info(f"checking {directory}")
        needs = experiment.learners, experiment.iterations, self._value("bag_digest")
        self._bag = open_bag(directory, self._game, *needs)
        max_in_flight = self._value("max_in_flight")
        self._streams = {name: Stream(experiment.iterations, max_in_flight) for name in experiment.learners}
        self._claims = {name: AckFilter(PATIENCE) for name in experiment.learners}
        self._paused = False
        self._held_back: set[str] = set()
        self.done = False
        self._publishers_by_learner = {name: self._connect(name) for name in experiment.learners}
        self._timer = self.create_timer(1.0, self._play)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, diagnostics.DEPTH)
        self.create_timer(diagnostics.PERIOD, self._publish_diagnostics)
        self.add_post_set_parameters_callback(self._on_parameters)
        self.create_service(SetBool, "~/pause", self._on_pause)
        self.create_service(PlayNext, "~/play_next", self._on_play_next)
        self.create_service(Resend, "~/resend", self._on_resend)
        self.get_logger().info(f"{directory}: waiting for {', '.join(self._streams)}")

    def destroy_node(self) -> None:
        """Close the bag with the node."""
        self._bag.close()
        super().destroy_node()

    def _declare_parameters(self) -> None:
        declare_experiment(self)
        self.declare_parameter("bag", "", str_param("bag to play; empty: the experiment's"))
        self.declare_parameter("bag_digest", "", str_param("digest of what it must hold; empty: anything"))
        self.declare_parameter(
            "baseline", "", str_param("a central method that learns in the learners' place; empty: none")
        )
        self.declare_parameter(
            "max_in_flight", 16, int_param("demonstrations ahead of what a learner has learned", 1, HISTORY)
        )
        self.declare_parameter(
            "rate", 1.0, float_param("speed, as a multiple of the recorded timing", 0.01, 1e4, fixed=False)
        )
        self.declare_parameter(
            "hz",
            0.0,
            float_param("demonstrations per second; 0: the recorded timing times rate", 0.0, 1e4, fixed=False),
        )

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _connect(self, learner: str) -> Any:
        acknowledging = self._value("baseline") or learner
        self.create_subscription(
            LearnerStatus, f"{acknowledging}/{topics.STATUS}", partial(self._on_status, learner), latched(STATUS_DEPTH)
        )
        return self.create_publisher(Demonstration, f"{learner}/{topics.DEMONSTRATION}", latched(HISTORY))

    def _on_status(self, learner: str, status: LearnerStatus) -> None:
        if not (self._same_network(learner, status) and self._possible(learner, status)):
            return
        stream, now = self._streams[learner], time.monotonic()
        learned = self._claims[learner].accepted(status.last_demonstration, stream.sent, now)
        if learned != status.last_demonstration:
            self._report_contradiction(learner, status.last_demonstration, learned)
        if learned is None:
            return
        stream.acknowledge(learned)
        if status.state == LearnerStatus.WAITING_FOR_DEMONSTRATION:
            for iteration in stream.missing(now, PATIENCE):
                self.get_logger().warning(f"{learner} still waits for demonstration {iteration}: sending it again")
                self._publish(learner, iteration)
        self._play()

    def _report_contradiction(self, learner: str, claimed: int, learned: int | None) -> None:
        believed = "nothing yet" if learned is None else learned
        self.get_logger().warning(
            f"{learner} says that it learned {claimed}, which contradicts what was sent or said before; believed:"
            f" {believed}. It was started again, or somebody else speaks in its name",
            throttle_duration_sec=10.0,
        )

    def _possible(self, learner: str, status: LearnerStatus) -> bool:
        """Is the status from ``learner``, and within what there is to learn? Says so where it is not."""
        name, total = self._value("baseline") or learner, self._streams[learner].total
        if status.learner == name and status.last_demonstration <= total:
            return True
        self.get_logger().error(
            f"a status on {name}'s topic is of {truncate(status.learner)!r} and says that it learned"
            f" {status.last_demonstration} of {total}; it is ignored, look for a second publisher",
            throttle_duration_sec=10.0,
        )
        return False

    def _same_network(self, learner: str, status: LearnerStatus) -> bool:
        """Does the learner run the same game, experiment and schedule? Says so where it does not."""
        expected = {
            "game": (status.game_digest, self._game.digest),
            "experiment": (status.experiment_digest, self._experiment_digest),
            "schedule": (status.schedule_digest, self._schedule_digest),
        }
        different = {name: pair for name, pair in expected.items() if pair[0] != pair[1]}
        for name, (theirs, ours) in different.items():
            self.get_logger().error(
                f"{learner} has another {name}: digest {truncate(theirs)}, here {ours}; start both with the same"
                " experiment file and run",
                throttle_duration_sec=10.0,
            )
        return not different

    def _play(self) -> None:
        """Send what is due and permitted, then set the timer to the next due time."""
        now = time.monotonic()
        for learner, stream in self._streams.items():
            while stream.open and not self._paused and (due := self._due(learner)) <= now:
                self._publish(learner, stream.mark_sent(now, due))
            self._report_holding_back(learner, stream)
        self.done = all(stream.finished for stream in self._streams.values())
        self._set_timer(now)

    def _due(self, learner: str) -> float:
        return self._streams[learner].due_at(partial(self._gap, learner))

    def _gap(self, learner: str, iteration: int) -> float:
        """Seconds from demonstration ``iteration`` - 1 to ``iteration`` at the present speed."""
        hz = self._value("hz")
        if hz > 0:
            return 1.0 / hz
        recorded = self._bag.time(learner, iteration) - self._bag.time(learner, iteration - 1)
        return recorded / NANOSECONDS / self._value("rate")

    def _set_timer(self, now: float) -> None:
        """Wake up when the next demonstration is due; long after where only a learner's status can open a stream.

        The timer is never cancelled: an executor that has just found it ready would fail to call it.
        """
        open_streams = [] if self._paused else [name for name, stream in self._streams.items() if stream.open]
        pause = min((self._due(name) - now for name in open_streams), default=IDLE)
        self._timer.timer_period_ns = max(1, int(min(pause, IDLE) * NANOSECONDS))
        self._timer.reset()

    def _publish(self, learner: str, iteration: int) -> None:
        message = self._bag.message(learner, iteration)
        message.experiment_digest = self._experiment_digest
        self._publishers_by_learner[learner].publish(message)

    def _report_holding_back(self, learner: str, stream: Stream) -> None:
        """Say when holding back begins, and when the learner has made up for half of that."""
        if stream.held_back and learner not in self._held_back:
            self._held_back.add(learner)
            self.get_logger().info(
                f"holding {learner} back: sent {stream.sent}, learned {stream.acknowledged},"
                f" max_in_flight {stream.max_in_flight}"
            )
        elif learner in self._held_back and 2 * (stream.sent - stream.acknowledged) <= stream.max_in_flight:
            self._held_back.remove(learner)
            self.get_logger().info(f"{learner} caught up to {stream.acknowledged}")

    def _publish_diagnostics(self) -> None:
        stamp = time_message(self.get_clock().now().nanoseconds)
        message = playing_diagnostic(self.get_name(), self._streams, stamp, paused=self._paused)
        self._diagnostics_publisher.publish(message)

    def _on_parameters(self, parameters: list[Parameter]) -> None:
        """A new rate or hz holds from the next demonstration on."""
        if {parameter.name for parameter in parameters} & {"rate", "hz"}:
            self._play()

    def _on_pause(self, request: SetBool.Request, response: SetBool.Response) -> SetBool.Response:
        self._paused = request.data
        self._play()
        response.success, response.message = True, "paused" if self._paused else "playing"
        return response

    def _on_play_next(self, request: PlayNext.Request, response: PlayNext.Response) -> PlayNext.Response:
        if not self._paused:
            response.message = "expected a paused player; call pause with data: true first"
            return response
        now, sent = time.monotonic(), 0
        for learner, stream in self._streams.items():
            before = stream.sent
            while stream.open and stream.sent < before + request.count:
                self._publish(learner, stream.mark_sent(now, now))
            sent += stream.sent - before
        response.success, response.message = True, f"published {sent} demonstrations"
        return response

    def _on_resend(self, request: Resend.Request, response: Resend.Response) -> Resend.Response:
        stream = self._streams.get(request.learner)
        if stream is None or not 1 <= request.iteration <= stream.sent:
            sent = {name: stream.sent for name, stream in self._streams.items()}
            learner = truncate(request.learner)
            response.message = f"{learner!r} iteration {request.iteration}: expected one of those sent, {sent}"
            return response
        self._publish(request.learner, request.iteration)
        response.success, response.message = True, "published again"
        return response


HELP = """Stream recorded demonstrations, each learner's to that learner alone.

usage: mabirds-expert-player --ros-args -p experiment:=FILE [-p PARAMETER:=VALUE ...]

example: mabirds-expert-player --ros-args -p experiment:=ros_ws/config/patrol.yaml -p rate:=10.0

parameters:
  experiment      path of the experiment file (YAML)
  run             name of this run; learners of other runs get nothing ("")
  baseline        a central method that learns in the learners' place, such as bics ("")
  bag             bag to play; empty: the experiment's
  bag_digest      digest of the demonstrations that it must hold, such as a manifest names; empty: any ("")
  rate            speed, as a multiple of the recorded timing (1.0); may change while it runs
  hz              demonstrations per second; 0: the recorded timing times rate (0.0); may change while it runs
  max_in_flight   demonstrations ahead of what a learner has learned (16)

services: ~/pause (std_srvs/SetBool), ~/play_next, ~/resend (mabirds_msgs)

It ends when everything is learned, or on SIGINT or SIGTERM.
Exit codes: 0 finished or ended as asked, 2 wrong experiment, bag or parameter."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``mabirds-expert-player``."""
    prepare_environment()
    return run_node(ExpertPlayerNode, HELP, arguments)
