"""Learners that listen to demonstrations and say what they are told to say, for tests of the player."""

import time
from collections import defaultdict
from typing import Any

from mabirds_msgs.msg import Demonstration, LearnerStatus

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py.qos import STATUS_QOS, latched


class PretendLearners:
    """Listens to demonstrations and acknowledges them only when told to."""

    def __init__(self, nodes: Any, experiment: Experiment, game_digest: str = "") -> None:
        self.node = nodes.plain("pretend_learners")
        self.experiment = experiment
        self.game_digest = game_digest or build_game(experiment).digest
        self.received: defaultdict[str, list[int]] = defaultdict(list)
        self.times: defaultdict[str, list[float]] = defaultdict(list)
        self._publishers = {}
        for name in experiment.learners:
            self._publishers[name] = self.node.create_publisher(LearnerStatus, f"/{name}/status", STATUS_QOS)
            self.node.create_subscription(Demonstration, f"/{name}/demonstration", self._on_demonstration, latched(256))

    def _on_demonstration(self, message: Demonstration) -> None:
        self.received[message.learner].append(message.iteration)
        self.times[message.learner].append(time.monotonic())

    def acknowledge(self, name: str, iteration: int) -> None:
        self._publishers[name].publish(
            LearnerStatus(
                learner=name,
                game_digest=self.game_digest,
                experiment_digest=self.experiment.digest,
                schedule_digest=self.experiment.edge_schedule.digest,
                last_demonstration=iteration,
                state=LearnerStatus.WAITING_FOR_DEMONSTRATION,
            )
        )
