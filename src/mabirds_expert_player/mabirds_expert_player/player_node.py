"""The expert player: streams each learner's recorded demonstrations to that learner alone.

``rate`` multiplies the recorded timing; ``hz`` above 0 overrides it with demonstrations per second. Both may change
while the node runs. Nothing is sent before a learner has announced itself with the right game, and never more than
``max_in_flight`` demonstrations beyond what it has learned. With ``listeners`` it plays to whoever looks, too.
"""

import time
from collections.abc import Sequence
from functools import partial
from itertools import islice
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray
from mabirds_msgs.msg import Demonstration, LearnerStatus, PlayerStatus
from mabirds_msgs.srv import Resend
from rclpy.duration import Duration
from rclpy.parameter import Parameter
from rosgraph_msgs.msg import Clock as ClockMessage

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, method_names
from mabirds_core.experiment.differences import settings_lines
from mabirds_core.experiment.file import Experiment
from mabirds_core.texts import truncate
from mabirds_expert_player.alarm import IDLE, Alarm
from mabirds_expert_player.diagnostics import playing_diagnostic
from mabirds_expert_player.playback import LONG_WAIT, Playback
from mabirds_expert_player.player_control import PlayerControl
from mabirds_expert_player.player_help import HELP
from mabirds_expert_player.player_parameters import (
    HISTORY,
    bags_of,
    chosen_learners,
    declare_parameters,
    gap_limit,
    is_partial,
    part_of,
)
from mabirds_expert_player.player_status import player_status
from mabirds_expert_player.read_ahead import ReadAhead
from mabirds_expert_player.same_network import contradiction, what_is_other
from mabirds_expert_player.stream import AckFilter, Stream
from mabirds_msgs_py import diagnostics, topics
from mabirds_msgs_py.bag_digest import require_digest
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.conversion import time_message
from mabirds_msgs_py.demonstration_origin import played_to
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.network_node import NetworkNode
from mabirds_msgs_py.node_main import run_node
from mabirds_msgs_py.player_services import RESEND, STATUS
from mabirds_msgs_py.qos import STATUS_QOS, latched
from mabirds_msgs_py.ros_parameters import experiment_of
from mabirds_msgs_py.settings_inquiry import SettingsInquiry
from mabirds_msgs_py.solitude import Solitude, nobody_heard

PATIENCE = 2.0
"""Seconds after which a demonstration that a waiting learner does not acknowledge is sent again.

And until statuses that contradict each other are believed to be a learner's or a player's new start."""

STEP_LOOK = 0.5
"""Seconds between two looks while a step waits for learners."""

STATUS_DEPTH = 10
"""Statuses of a learner that wait to be read; one would be hidden by those of a namesake in another run."""

BATCH = 64
"""Demonstrations that are sent before anybody else is listened to."""

ALONE = 3.5
"""Seconds after which a player says that nobody is there."""

GATHERING = 0.005
"""Seconds for which statuses gather where learners have enough before them and nothing can become due."""

SPEEDS = ("rate", "hz")


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
        declare_parameters(self)
        experiment, self._experiment_digest = experiment_of(self)
        self._schedule_digest = experiment.edge_schedule.digest
        self._baseline = self._value("baseline")
        if self._baseline not in ("", *method_names()):
            raise ExperimentError(f"baseline {self._baseline!r}: expected one of {method_names()}, or nothing")
        self._game = build_game(experiment)
        self._inquiry = SettingsInquiry(self, settings_lines(experiment, self._value("run")))
        self._solitude = Solitude(ALONE)
        self._totals = dict.fromkeys(experiment.learners, experiment.iterations)
        self._learners = chosen_learners(self, experiment.learners)
        self._bag = self._open_bag(experiment)
        self.playback = self._make_playback(experiment)
        self._origin = played_to(self._experiment_digest, self._value("bag_digest"))
        self._claims = {name: AckFilter(PATIENCE) for name in self._learners}
        self._held_back, self._long_waits = set[str](), set[tuple[str, int]]()
        self.done, self.answers, self.answer = False, 0, ""
        self.gather = 0.0
        self._publishers_by_learner = {name: self._connect(name) for name in self._learners}
        self._ahead = {name: ReadAhead(self._bag, name, self._value("read_ahead")) for name in self._learners}
        self._status_publisher = self.create_publisher(PlayerStatus, f"~/{STATUS}", STATUS_QOS)
        self._diagnostics_publisher = self.create_publisher(DiagnosticArray, topics.DIAGNOSTICS, diagnostics.DEPTH)
        self._alarm = Alarm(self, self._play)
        self.create_timer(diagnostics.PERIOD, self._on_timer)
        self._publish_clock()
        self.add_post_set_parameters_callback(self._on_parameters)
        self.control = PlayerControl(self, self.playback, self._play, self._tell)
        self.create_service(Resend, f"~/{RESEND}", self._on_resend)
        self._play()

    def destroy_node(self) -> None:
        """Close the bag with the node."""
        self._bag.close()
        super().destroy_node()

    def _open_bag(self, experiment: Experiment) -> DemonstrationBag:
        bags = bags_of(self, experiment)
        self.get_logger().info(f"checking {', '.join(map(str, bags))}")
        least = 1 if is_partial(self) else experiment.iterations
        bag = DemonstrationBag(bags, self._game, self._learners, at_least=least)
        require_digest(bag, self._learners, experiment.iterations, self._value("bag_digest"))
        waits = "" if self._value("listeners") else f": waiting for {', '.join(self._learners)}"
        self.get_logger().info(f"{', '.join(map(str, bags))}{waits}")
        return bag

    def _make_playback(self, experiment: Experiment) -> Playback:
        in_flight, looked_at = self._value("max_in_flight"), self._value("listeners")
        streams = {
            name: Stream(min(experiment.iterations, self._bag.count(name)), in_flight, looked_at=looked_at)
            for name in self._learners
        }
        part = part_of(self, self._bag, self._learners)
        playback = Playback(self._bag, streams, part, self._value("loop"), gap_limit(self))
        now = time.monotonic()
        playback.not_before, playback.hz = now + self._value("delay"), float(self._value("hz"))
        playback.clock.since, playback.clock.paused = now, self._value("start_paused")
        playback.clock.set_rate(float(self._value("rate")), now)
        return playback

    def _value(self, name: str) -> Any:
        return self.get_parameter(name).value

    def _connect(self, learner: str) -> Any:
        topic = f"{self._node_of(learner)[0]}/{topics.STATUS}"
        self.create_subscription(LearnerStatus, topic, partial(self._on_status, learner), latched(STATUS_DEPTH))
        return self.create_publisher(Demonstration, f"{learner}/{topics.DEMONSTRATION}", latched(HISTORY))

    def _on_status(self, learner: str, status: LearnerStatus) -> None:
        if not (self._same_network(learner, status) and self._possible(learner, status)):
            return
        stream, now = self.playback.streams[learner], time.monotonic()
        learned = self._claims[learner].accepted(status.last_demonstration, stream.sent, now)
        if learned != status.last_demonstration:
            self._report_contradiction(learner, status.last_demonstration, learned)
        if learned is None:
            return
        if not stream.ready and stream.looked_at:
            self._tell(f"{learner} learns here, from demonstration {learned + 1} on")
        if not stream.ready and 0 < learned <= self._bag.count(learner):
            self._publish(learner, learned)  # once more: by it the learner knows whether the bag is still the same
        stream.acknowledge(learned)
        if status.state == LearnerStatus.WAITING_FOR_DEMONSTRATION:
            for iteration in stream.missing(now, PATIENCE):
                self.get_logger().warning(f"{learner} still waits for demonstration {iteration}: sending it again")
                self._publish(learner, iteration)
        self._play()

    def _report_contradiction(self, learner: str, claimed: int, learned: int | None) -> None:
        others = self.count_publishers(f"{learner}/{topics.DEMONSTRATION}") > 1
        words = contradiction(learner, claimed, learned, second_player=others)
        self.get_logger().warning(words, throttle_duration_sec=10.0)

    def _possible(self, learner: str, status: LearnerStatus) -> bool:
        """Is the status from ``learner``, and within what there is to learn? Says so where it is not."""
        name, total = self._baseline or learner, self._totals[learner]
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
        theirs = status.game_digest, status.experiment_digest, status.schedule_digest
        ours = self._game.digest, self._experiment_digest, self._schedule_digest
        if theirs == ours:
            return True
        other, found = ", ".join(what_is_other(theirs, ours)), self._inquiry.words(*self._node_of(learner))
        words = f"{learner} has {other}; start both with the same experiment file and run. {found}"
        self.get_logger().error(words, throttle_duration_sec=3.0)
        return False

    def _node_of(self, learner: str) -> tuple[str, str]:
        """Namespace and name of the node that learns in a learner's place, or is it."""
        return (self._baseline, "baseline") if self._baseline else (learner, "learner")

    def _play(self) -> None:
        """Send what is due and permitted, then set the alarm to the next due time."""
        now = time.monotonic()
        for learner, iteration in islice(self.playback.due(now), BATCH):
            self._publish(learner, iteration)
        for learner, stream in self.playback.streams.items():
            self._report_holding_back(learner, stream)
        self.control.look()
        if self.playback.finished and not self.done and not self._value("stay"):
            self._end()
        self._set_alarm(now)

    def _end(self) -> None:
        """Everything is played; what is under way to listeners may be waited for."""
        patience = self._value("wait_for_all_acked")
        if patience >= 0:
            for learner, publisher in self._publishers_by_learner.items():
                if not publisher.wait_for_all_acked(Duration(seconds=patience)):
                    self.get_logger().warning(f"{learner}: not all who listen had everything after {patience:g} s")
        self.done = True
        self._publish_standing()

    def _set_alarm(self, now: float) -> None:
        """Wake up when the next demonstration is due; long after where only a learner's status can open a stream."""
        wait = self.playback.next_wait(now)
        pause = wait.seconds if wait else IDLE
        if self.playback.owed:
            pause = min(pause, STEP_LOOK)
        elif pause > 0:
            for name, stream in self.playback.streams.items():
                self._ahead[name].fill(stream.sent, stream.total)
        if wait and wait.seconds > LONG_WAIT:
            self._report_long_wait(wait.learner, wait.seconds)
        self.gather = GATHERING if wait is None and self.playback.supplied else 0.0
        self._alarm.set(now, pause)

    def _report_long_wait(self, learner: str, pause: float) -> None:
        """Once for each gap: a night in the recording looks like a player that hangs."""
        following = self.playback.streams[learner].sent + 1
        if (learner, following) not in self._long_waits:
            self._long_waits.add((learner, following))
            recorded = self.playback.gap(learner, following)
            self._tell(
                f"{learner}: demonstration {following} was recorded {recorded:.0f} s after the one before and comes in"
                f" {pause:.0f} s; play_next steps over such gaps while paused, max_gap shortens them"
            )

    def _publish(self, learner: str, iteration: int) -> None:
        message = self._ahead[learner].take(iteration)
        message.experiment_digest = self._origin
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

    def _tell(self, words: str) -> None:
        """Tell people what was done, in the log and in the status."""
        self.answers, self.answer = self.answers + 1, words
        self.get_logger().info(words)
        self._publish_standing()

    def _on_timer(self) -> None:
        anybody = any(self.count_publishers(f"{self._node_of(name)[0]}/{topics.STATUS}") for name in self._learners)
        if self._solitude.begins(anybody=anybody or self._value("listeners")):
            self.get_logger().warning(nobody_heard("a learner nor another listener"))
        self._publish_standing()

    def _publish_standing(self) -> None:
        stamp = time_message(self.get_clock().now().nanoseconds)
        paused = self.playback.clock.paused
        message = playing_diagnostic(self.get_name(), self.playback.streams, stamp, paused=paused)
        self._diagnostics_publisher.publish(message)
        self._status_publisher.publish(self.status())

    def status(self) -> PlayerStatus:
        """Where it is, as it publishes it."""
        status = player_status(self.playback, time.monotonic())
        status.stamp = time_message(self.get_clock().now().nanoseconds)
        status.experiment_digest = self._experiment_digest
        status.playing = not (self.playback.finished or self.done)
        status.answers, status.answer = self.answers, self.answer
        return status

    def _publish_clock(self) -> None:
        """Recorded time to /clock, as often as asked for."""
        frequency = self._value("clock")
        if frequency == 0:
            return
        publisher = self.create_publisher(ClockMessage, "/clock", 1)

        def publish() -> None:
            publisher.publish(ClockMessage(clock=time_message(self.playback.position(time.monotonic()))))

        self.create_timer(1 / frequency, publish)

    def _on_parameters(self, parameters: list[Parameter]) -> None:
        """A new rate or hz holds at once."""
        values = {parameter.name: float(parameter.value) for parameter in parameters if parameter.name in SPEEDS}
        if "rate" in values:
            self.playback.clock.set_rate(values["rate"], time.monotonic())
        if "hz" in values:
            self.playback.hz = values["hz"]
        if values:
            self._tell(", ".join(f"{name} {value:g}" for name, value in values.items()))
            self._play()

    def _on_resend(self, request: Resend.Request, response: Resend.Response) -> Resend.Response:
        stream = self.playback.streams.get(request.learner)
        if stream is None or not 1 <= request.iteration <= stream.sent:
            sent = {name: stream.sent for name, stream in self.playback.streams.items()}
            learner = truncate(request.learner)
            response.message = f"{learner!r} iteration {request.iteration}: expected one of those sent, {sent}"
            return response
        self._publish(request.learner, request.iteration)
        response.success, response.message = True, "published again"
        return response


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``mabirds-expert-player``."""
    prepare_environment()
    return run_node(ExpertPlayerNode, HELP, arguments)
