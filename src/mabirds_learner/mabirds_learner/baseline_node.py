"""A central method as a ROS node, to compare with: it subscribes to the demonstrations of all learners.

Started in the namespace of its method (/bics, /ftl, /dlm, /me_greedy, /me_gradient), in the place of the learners. It
publishes what a learner publishes, so that the player, the monitor and `mabirds inspect` take it for one.
"""

import sys
from collections.abc import Sequence
from functools import partial
from typing import Any

from mabirds_msgs.msg import Demonstration

from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_game, build_method
from mabirds_learner.baseline_session import BaselineSession
from mabirds_learner.progress_node import ProgressNode
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import read_demonstration
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.node_main import run_node
from mabirds_msgs_py.qos import latched

PARAMETER_HISTORY = 256
"""Iterations of parameters that a late joiner still gets."""


class BaselineNode(ProgressNode):
    """The method of its namespace's name on an experiment.

    Parameters
    ----------
    **node_options : Any
        Of ``rclpy.node.Node``.

    Raises
    ------
    MabirdsError
        The experiment or the name is wrong.
    """

    session: BaselineSession

    def __init__(self, **node_options: Any) -> None:
        super().__init__("baseline", **node_options)
        experiment, history = self.experiment, self.get_param("demonstration_history")
        game = build_game(experiment)
        method = build_method(experiment, self.learner_name, game)
        self.session = BaselineSession(method, experiment.learners, experiment.iterations, history)
        self.start(game, PARAMETER_HISTORY)
        for learner in experiment.learners:
            topic = f"{self.namespace_prefix}{learner}/{topics.DEMONSTRATION}"
            self.create_subscription(Demonstration, topic, partial(self._on_demonstration, learner), latched(history))

    def _on_demonstration(self, learner: str, message: Demonstration) -> None:
        try:
            trajectory = read_demonstration(self.game, learner, message, self.experiment_digest)
            self.session.receive_demonstration(learner, message.iteration, trajectory)
        except RefusedMessageError as error:
            self.reject(f"{topics.DEMONSTRATION} {message.iteration} of {learner}", error)
        else:
            self.go_on()


HELP = """Run a central method on the demonstrations of all learners.

Its namespace says which: bics, ftl, dlm, me_greedy or me_gradient.

usage: mabirds-baseline --ros-args -r __ns:=/METHOD -p experiment:=FILE [-p PARAMETER:=VALUE ...]

example: mabirds-baseline --ros-args -r __ns:=/bics -p experiment:=ros_ws/config/patrol.yaml

parameters:
  experiment              path of the experiment file (YAML)
  demonstration_history   demonstrations of a learner kept ahead of the current iteration (256)
  run                     name of this run; messages of other runs are refused ("")
  status_period           seconds between status messages while nothing changes (1.0)

The player must be told to wait for it: -p baseline:=METHOD.
It ends on SIGINT or SIGTERM. Exit codes: 0 ended as asked, 2 wrong experiment, method or parameter."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Entry point of ``mabirds-baseline``."""
    prepare_environment()
    return run_node(BaselineNode, HELP, arguments)


if __name__ == "__main__":
    sys.exit(main())
