"""One learner as a ROS node: parameters, conversion, a call into core, a publication.

Started in the namespace of its name (/learner_1). It subscribes to its own demonstrations and to what its scheduled
in-neighbours tell (strict_exchange, push_sum_exchange), and to nothing else.
"""

import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from mabirds_msgs.msg import Constraints, Demonstration
from mabirds_msgs.srv import FetchParameters
from rclpy.executors import ExternalShutdownException

from mabirds_core.algorithm.learner import Learner
from mabirds_core.consensus.push_sum_mixer import ResilientMixing
from mabirds_core.errors import CheckpointError, RefusedMessageError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.games.whole_game import Game
from mabirds_learner.checkpoint import CheckpointMetadata, CheckpointStore
from mabirds_learner.exchange import Exchange, Identity
from mabirds_learner.learner_session import LearnerSession
from mabirds_learner.lookout import Lookout, Sight
from mabirds_learner.member import Limits
from mabirds_learner.outlet import NodeOutlet
from mabirds_learner.progress_node import ProgressNode
from mabirds_learner.strict_exchange import StrictExchange
from mabirds_learner.strict_member import StrictMember, default_history
from mabirds_msgs_py import topics
from mabirds_msgs_py.constraints_conversion import constraints_message, constraints_text
from mabirds_msgs_py.conversion import read_demonstration
from mabirds_msgs_py.demonstration_origin import bag_of, network_of
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.node_main import run_node
from mabirds_msgs_py.presence import MAX_DIGEST, MAX_STRANGERS, LivelinessMonitor
from mabirds_msgs_py.qos import LIVELINESS_LEASE, STATUS_QOS, latched
from mabirds_msgs_py.ros_parameters import bool_param, int_param, str_param

UNSAVED = "unsaved_checkpoint"
"""Counted at each attempt to save that fails."""

DUPLICATE_NAME = "duplicate_name"
"""Counted at each look at which several processes are seen to publish as one neighbour."""

SAVE_AGAIN = 1.0
"""Seconds after which a checkpoint that could not be written is tried again."""

FAREWELL = 5.0
"""Seconds for which a departed learner lives on, so that others hear its last status."""

NAMED = 3
"""Constraints that the last status names."""


class LearnerNode(ProgressNode):
    """Learner v of an experiment.

    Parameters
    ----------
    **node_options : Any
        Of ``rclpy.node.Node``.

    Raises
    ------
    MabirdsError
        The experiment, the name or the history is wrong, or checkpoints are of no use.
    """

    session: LearnerSession

    def __init__(self, **node_options: Any) -> None:
        super().__init__("learner", **node_options)
        self._declare_parameters()
        self.parameter_history = self.get_param("parameter_history") or default_history(self.schedule)
        self.presence = LivelinessMonitor(self._on_presence)
        self.session, self._exchange = self._session_and_exchange()
        self._departed_at: float | None = None
        self.done = False
        self._checkpoints = self._open_checkpoints()
        self._constraints_publisher = self.create_publisher(Constraints, topics.CONSTRAINTS, STATUS_QOS)
        self.start(cast("Game", self.session.learner.game), self.parameter_history)  # of build_game
        history = latched(self.get_param("demonstration_history"))
        self.create_subscription(Demonstration, topics.DEMONSTRATION, self._on_demonstration, history)
        self.create_service(FetchParameters, self.service_name(topics.FETCH_PARAMETERS), self._on_fetch)
        self._exchange.connect()
        self._strangers: set[str] = set()
        self._lookout = Lookout(self.learner_name, self._look, self._warn)

    def _look(self) -> Sight:
        """Players of other runs play to the same topic; their demonstrations tell whose they are."""
        players = self.count_publishers(topics.DEMONSTRATION)
        heard = (self.schedule.learners[u] for u in self.schedule.all_in_neighbours(self.session.learner.index))
        neighbours = sum(self.count_publishers(f"{self.namespace_prefix}{u}/{topics.STATUS}") for u in heard)
        namesakes = self.count_services(self.service_name(topics.FETCH_PARAMETERS))
        return Sight(players - len(self._strangers), namesakes, players + neighbours)

    def _warn(self, words: str) -> None:
        self.set_event(words, log=False)
        self.get_logger().warning(words)

    def _session_and_exchange(self) -> tuple[LearnerSession, Exchange]:
        """Both as the experiment's mixing asks."""
        mixing, learner = self.experiment.mixing, build_learner(self.experiment, self.learner_name)
        identity = Identity(self.learner_name, self.experiment_digest, self.schedule)
        outlet = NodeOutlet(self, self.presence, self.parameter_history)
        here = (identity, outlet, self.go_on)
        if isinstance(mixing, ResilientMixing):
            return self._resilient(learner, mixing.patience, *here)
        strict = LearnerSession(StrictMember(learner, self._limits))
        return strict, StrictExchange(strict, *here)

    def _resilient(self, learner: Learner, patience: float, *here: Any) -> tuple[LearnerSession, Exchange]:
        from mabirds_learner.push_sum_exchange import PushSumExchange  # all of it where it is asked for alone
        from mabirds_learner.push_sum_member import PushSumMember
        from mabirds_msgs_py.declaration_key import read_key

        resilient = LearnerSession(PushSumMember(learner, self._limits, late_joiner=self.get_param("late_joiner")))
        file = self.get_param("declaration_key")
        key = read_key(Path(file)) if file else b""
        return resilient, PushSumExchange(resilient, *here, patience=patience, save=self.save, key=key)

    @property
    def _limits(self) -> Limits:
        experiment, history = self.experiment, self.get_param("demonstration_history")
        return Limits(experiment.iterations, history, self.parameter_history, experiment.closing_rounds)

    def _declare_parameters(self) -> None:
        words = "iterations of parameters kept; 0: as many as the schedule needs, at least 256"
        self.declare_parameter("parameter_history", 0, int_param(words, 0, 100_000))
        self.declare_parameter("checkpoints", "", str_param("directory of this learner's checkpoints; empty: none"))
        words = "resilient mode: file of the key that declarations are signed with; empty: anybody may declare"
        self.declare_parameter("declaration_key", "", str_param(words))
        words = "resilient mode: take part once a declaration says so"
        self.declare_parameter("late_joiner", value=False, descriptor=bool_param(words))

    def _open_checkpoints(self) -> CheckpointStore | None:
        """The place of the checkpoints, after going on from what is there; None where none was named."""
        if not self.get_param("checkpoints"):
            return None
        metadata = CheckpointMetadata(self.learner_name, self.experiment_digest, self.schedule.digest)
        place, history = Path(self.get_param("checkpoints")), self.parameter_history
        store = CheckpointStore(place, metadata, self.session.parameters, history)
        if checkpoints := store.load():
            self.session.restore(checkpoints)
            self.set_event("; ".join([f"resumed at iteration {self.session.iteration}", *store.refused]))
        else:
            store.save(self.session.iteration, self.session.arrays())  # a neighbour may ask for the first one, too
        return store

    def destroy_node(self) -> None:
        """Let go of the checkpoints with the node."""
        if self._checkpoints:
            self._checkpoints.close()
        super().destroy_node()

    def save(self) -> None:
        """Write a checkpoint: before anybody hears of it, so that a restart cannot take back what was said.

        Where it cannot be written, as on a full disk, this learner waits until it can.
        """
        while self._checkpoints and not self._is_saved(self._checkpoints):
            time.sleep(SAVE_AGAIN)
            if not self.context.ok():
                raise ExternalShutdownException

    def _is_saved(self, checkpoints: CheckpointStore) -> bool:
        try:
            checkpoints.save(self.session.iteration, self.session.arrays())
        except CheckpointError as error:
            self.count_drop(UNSAVED, f"waits to save iteration {self.session.iteration}: {error}")
            self.publish_status()
            return False
        return True

    def publish_history(self) -> None:
        """Also what an earlier life of this learner may have taken along unsent."""
        for iteration, parameters in self.session.kept.items():
            self.publish_parameters(iteration, parameters)
        self._publish_constraints()

    def publish_update(self) -> None:
        """theta and omega, what neighbours are to have of them, and at the end what is forbidden by them."""
        if constraints := self._publish_constraints():
            self.set_event(constraints)
        super().publish_update()
        self._exchange.publish()

    def _publish_constraints(self) -> str:
        """Tell what is forbidden, once all is learned, for the test takes a solve per feature; returns the surest."""
        confidences = self.session.constraint_confidences() if self.session.finished else None
        if confidences is None:
            return ""
        if self._checkpoints:
            self._checkpoints.keep_confidences(self.session.iteration, confidences)
        names, level = self.game.cost_features.names, self.experiment.constraint_confidence
        message = constraints_message(names, confidences, level)
        message.stamp, message.learner, message.iteration = self.stamp(), self.learner_name, self.session.iteration
        message.experiment_digest = self.experiment_digest
        self._constraints_publisher.publish(message)
        return constraints_text(message, NAMED)

    def _on_demonstration(self, message: Demonstration) -> None:
        try:
            trajectory = read_demonstration(self.game, self.learner_name, message, self.experiment_digest)
            self.session.receive_demonstration(message.iteration, trajectory, bag_of(message))
        except RefusedMessageError as error:
            if error.reason == "wrong_experiment" and len(self._strangers) < MAX_STRANGERS:
                self._strangers.add(network_of(message)[:MAX_DIGEST])
            self.reject(f"{topics.DEMONSTRATION} {message.iteration}", error)
        else:
            self.go_on()

    def _on_presence(self, name: str) -> None:
        alive = not self.presence.is_lost(name)
        self.set_event(f"{name} is {'back' if alive else f'gone: silent for {LIVELINESS_LEASE:g} s'}")
        self._exchange.on_presence(name, alive=alive)
        self.go_on()

    def on_timer(self) -> None:
        """Say that this learner lives, and mend what has been missing since the last time."""
        for name in self.presence.duplicates():  # of this run: others of that name are known by their messages
            self.count_drop(DUPLICATE_NAME, f"several processes publish as {name}; end all but one")
        self.publish_status()
        self._exchange.on_timer()
        self._end_where_departed()
        self._lookout.on_timer()

    def _end_where_departed(self) -> None:
        """A learner without which the network goes on says so for a while, and then its process ends."""
        if not self.session.member.departed:
            self._departed_at = None
        elif self._departed_at is None:
            self._departed_at = time.monotonic()
            self.set_event(f"departed: epoch {self.session.epoch} goes on without {self.learner_name}; this one ends")
            self.publish_status()
        self.done = self._departed_at is not None and time.monotonic() - self._departed_at > FAREWELL

    def _on_fetch(
        self, request: FetchParameters.Request, response: FetchParameters.Response
    ) -> FetchParameters.Response:
        written = self._checkpoints.parameters if self._checkpoints else {}
        parameters = self.session.kept.get(request.iteration) or written.get(request.iteration)
        response.found = parameters is not None
        if parameters is None:
            kept = list(self.session.kept)
            response.message = f"{self.learner_name} keeps iterations {kept[0]} to {kept[-1]}"
        else:
            response.parameters = self.parameters_message(request.iteration, parameters)
        return response


HELP = """Run one learner. Its name is its namespace; its process holds its own demonstrations only.

usage: mabirds-learner --ros-args -r __ns:=/NAME -p experiment:=FILE [-p PARAMETER:=VALUE ...]

example: mabirds-learner --ros-args -r __ns:=/learner_1 -p experiment:=ros_ws/config/patrol.yaml

parameters:
  experiment              path of the experiment file (YAML)
  demonstration_history   demonstrations kept ahead of the current iteration (256)
  run                     name of this run; messages of other runs are refused ("")
  checkpoints             directory of its checkpoints; it goes on from those that are there (none)
  late_joiner             resilient mode: take part only once a declaration of members says so (false)
  declaration_key         resilient mode: file of the key that declarations are signed with (none: anybody declares)
  parameter_history       iterations of parameters kept; 0: as many as the schedule needs, at least 256 (0)
  status_period           seconds between status messages while nothing changes (1.0)

It ends on SIGINT or SIGTERM. Exit codes: 0 ended as asked, 2 wrong experiment, name, parameter or checkpoints."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``mabirds-learner``."""
    prepare_environment()
    return run_node(LearnerNode, HELP, arguments)
