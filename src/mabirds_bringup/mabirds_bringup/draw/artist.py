"""Publishes what is drawn of one learner: grids, markers, paths and numbers."""

from collections.abc import Callable

from mabirds_msgs.msg import Demonstration
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.node import Node
from rclpy.publisher import Publisher
from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from mabirds_bringup.draw import drawings, messages, names
from mabirds_bringup.draw.imagined import Imagination
from mabirds_bringup.draw.scalars import ScalarTopics, scalars_of
from mabirds_bringup.watch.inspector import WatchedLearner
from mabirds_core.arrays import Array
from mabirds_core.costs.models import costs_of
from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.scene import Scene
from mabirds_core.games.whole_game import Game
from mabirds_msgs_py import topics
from mabirds_msgs_py.conversion import arrays, read_demonstration
from mabirds_msgs_py.qos import STATUS_QOS


class LearnerArtist:
    """Draws one learner.

    Parameters
    ----------
    node : Node
        That publishes.
    learner : WatchedLearner
        Whose newest messages are drawn.
    experiment : Experiment
        That it learns.
    game : Game
        Of the experiment.
    scene : Scene
        Of the game.
    """

    def __init__(self, node: Node, learner: WatchedLearner, experiment: Experiment, game: Game, scene: Scene) -> None:
        self._node, self.learner, self._experiment = node, learner, experiment
        self._game, self._scene = game, scene
        self.changed = set[str]()
        self._imagination = Imagination(experiment, learner.name, game, scene)
        self._markers = node.create_publisher(
            MarkerArray, names.of_learner(learner.namespace, names.MARKERS), STATUS_QOS
        )
        self._grids = {kind: self._for_experts(OccupancyGrid, kind) for kind in (names.COSTS, names.KEEPOUT)}
        self._paths = {names.IMAGINED: self._for_experts(Path, names.IMAGINED)}
        self._scalars = ScalarTopics(node, names.of_learner(learner.namespace, names.SCALARS))

    def _for_experts(self, kind: type, topic: str) -> list[Publisher]:
        of_experts = (names.of_expert(expert) for expert in range(len(self._scene.goals)))
        places = (names.of_learner(self.learner.namespace, topic, expert) for expert in of_experts)
        return [self._node.create_publisher(kind, place, STATUS_QOS) for place in places]

    def fits(self) -> bool:
        """Does the learner learn this game, with parameters of its shapes?"""
        status, message = self.learner.status, self.learner.parameters
        if status is None or message is None or status.game_digest != self._game.digest:
            return False
        return len(message.omega) == costs_of(self._game).size

    def show_scalars(self) -> None:
        """Publish the numbers of the newest status."""
        if self.learner.status is not None:
            self._scalars.publish(scalars_of(self.learner.status))

    def draw(self, header: Header) -> None:
        """Draw what has changed since the last time."""
        if not self.fits():
            return
        if self.changed & {"parameters", "constraints"}:
            self._draw_grids(header)
        if "constraints" in self.changed and self.learner.constraints is not None:
            self._markers.publish(drawings.constraint_markers(header, self._scene, self.learner.constraints))
        if "parameters" in self.changed and not self._draw_imagined(header):
            self.changed = {"parameters"}
            return
        self.changed.clear()

    def _draw_grids(self, header: Header) -> None:
        omega, threshold = arrays(self.learner.parameters).omega, self._experiment.constraint_threshold
        drawn = drawings.grids(header, self._scene, omega, threshold, self.learner.constraints)
        for kind, grids in ((names.COSTS, drawn.costs), (names.KEEPOUT, drawn.keepout)):
            for publisher, grid in zip(self._grids[kind], grids, strict=True):
                publisher.publish(grid)

    def _draw_imagined(self, header: Header) -> bool:
        """Follow the policy that theta and omega mean, if there is time for it; tells whether there was."""
        places = self._imagination.places(arrays(self.learner.parameters))
        if places is not None:
            self._publish_paths(names.IMAGINED, header, places[0])
        return places is not None

    def _publish_paths(self, kind: str, header: Header, places: Array) -> None:
        for expert, publisher in enumerate(self._paths[kind]):
            publisher.publish(messages.path(header, places[:, expert]))

    def hear_demonstrations(self, header_of: Callable[[], Header]) -> None:
        """Draw what the learner is shown, too: its demonstrations are its own, and this is asked for by people."""
        self._paths[names.DEMONSTRATED] = self._for_experts(Path, names.DEMONSTRATED)

        def on_demonstration(message: Demonstration) -> None:
            digest = self.learner.status.experiment_digest if self.learner.status else ""
            try:
                trajectory = read_demonstration(self._game, self.learner.name, message, digest)
            except RefusedMessageError as error:
                self.learner.refused[error.reason] += 1
                return
            self._publish_paths(names.DEMONSTRATED, header_of(), self._scene.positions(trajectory)[0])

        topic = f"{self.learner.namespace}/{topics.DEMONSTRATION}"
        self._node.create_subscription(Demonstration, topic, on_demonstration, STATUS_QOS)
