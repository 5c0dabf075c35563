"""A node that passes what a learner passes, and does nothing else: what rclpy and the middleware themselves cost.

As a learner does, it waits for its demonstration and for the parameters of all others, and then publishes its own and a
status. Nothing is checked, kept or learned.

usage: python -m mabirds_bringup.bench.exchange.bare --ros-args -r __ns:=/NAME -p experiment:=FILE
"""

import sys
from array import array
from functools import partial
from typing import Any

import rclpy
from mabirds_msgs.msg import Demonstration, LearnerStatus, Parameters
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from mabirds_core.experiment.assembly import build_game, build_learner
from mabirds_learner.strict_member import default_history
from mabirds_msgs_py import topics
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.qos import announced, latched
from mabirds_msgs_py.ros_parameters import declare_experiment, experiment_of

METRICS = 8
"""Numbers in a status, as a learner's has."""


class BareNode(Node):
    """Passes messages in lockstep with others of its kind."""

    def __init__(self) -> None:
        super().__init__("bare")
        declare_experiment(self)
        _, self._name = topics.split_namespace(self.get_namespace())
        self.experiment, self._digest = experiment_of(self)
        self._game, self._schedule = build_game(self.experiment).digest, self.experiment.edge_schedule.digest
        sizes = build_learner(self.experiment, self._name).initial_state().parameters
        self._theta, self._omega = (array("d", bytes(8 * values.size)) for values in sizes)
        others = [name for name in self.experiment.learners if name != self._name]
        self._heard: dict[str, int] = dict.fromkeys([*others, topics.DEMONSTRATION], 0)
        self._iteration, depth = 1, default_history(self.experiment.edge_schedule)
        self._parameters_publisher = self.create_publisher(Parameters, topics.PARAMETERS, announced(depth))
        self._status_publisher = self.create_publisher(LearnerStatus, topics.STATUS, latched(depth))
        self.create_subscription(
            Demonstration, topics.DEMONSTRATION, partial(self._on_message, topics.DEMONSTRATION), latched(256)
        )
        for name in others:
            topic = f"/{name}/{topics.PARAMETERS}"
            self.create_subscription(Parameters, topic, partial(self._on_message, name), announced(depth))
        self._publish()

    def _on_message(self, name: str, message: Any) -> None:
        self._heard[name] = max(self._heard[name], message.iteration)
        while self._iteration <= self.experiment.iterations and min(self._heard.values()) >= self._iteration:
            self._iteration += 1
            self._publish()

    def _publish(self) -> None:
        stamp = self.get_clock().now().to_msg()
        self._parameters_publisher.publish(
            Parameters(
                stamp=stamp,
                learner=self._name,
                iteration=self._iteration,
                experiment_digest=self._digest,
                schedule_digest=self._schedule,
                theta=self._theta,
                omega=self._omega,
            )
        )
        finished = self._iteration > self.experiment.iterations
        self._status_publisher.publish(
            LearnerStatus(
                stamp=stamp,
                learner=self._name,
                game_digest=self._game,
                experiment_digest=self._digest,
                schedule_digest=self._schedule,
                state=LearnerStatus.FINISHED if finished else LearnerStatus.LEARNING,
                iteration=self._iteration,
                last_demonstration=self._iteration - 1,
                mixed_from=[name for name in self._heard if name != topics.DEMONSTRATION],
                metric_names=[f"metric_{number}" for number in range(METRICS)],
                metric_values=[0.0] * METRICS,
            )
        )


def main() -> int:
    """Spin until SIGTERM."""
    prepare_environment()
    rclpy.init(args=sys.argv)
    executor = SingleThreadedExecutor()
    executor.add_node(BareNode())
    try:
        while rclpy.ok():
            executor.spin_once(timeout_sec=1.0)
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    return 0


if __name__ == "__main__":
    sys.exit(main())
