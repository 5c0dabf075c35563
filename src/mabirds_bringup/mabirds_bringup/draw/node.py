"""A node that draws: it hears what learners say, and publishes it as topics that RViz, Foxglove and Nav2 know.

It is a process of its own, so that learners spend no time on pictures, and is as fast as it can be, not as they are.
"""

from typing import Any

from std_msgs.msg import Header
from visualization_msgs.msg import MarkerArray

from mabirds_bringup.draw import drawings, names
from mabirds_bringup.draw.artist import LearnerArtist
from mabirds_bringup.draw.scalars import ScalarTopics
from mabirds_bringup.watch.edges import edge_states
from mabirds_bringup.watch.inspector import InspectorNode, WatchedLearner
from mabirds_bringup.watch.recent import RecentParameters
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, method_names
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.scene import scene_of
from mabirds_msgs_py.qos import STATUS_QOS


class DrawingNode(InspectorNode):
    """Draws the learners of an experiment.

    ``frame``: of all that is drawn, its origin the lower left corner of the game. ``rate``: drawings per second;
    numbers are published with every status. ``demonstrations``: draw those, too.
    Raises ExperimentError where the game has no look.
    """

    def __init__(
        self,
        experiment: Experiment,
        frame: str = "map",
        rate: float = 2.0,
        *,
        demonstrations: bool = False,
        **node_options: Any,
    ) -> None:
        self._experiment, self._game = experiment, build_game(experiment)
        scene = scene_of(self._game)
        if scene is None:
            raise ExperimentError(
                f"game {experiment.game.kind} has no places that could be drawn; give it a property scene"
            )
        super().__init__(self._on_message, name="drawing", **node_options)
        self._scene, self._frame, self._demonstrations = scene, frame, demonstrations
        self.artists: dict[str, LearnerArtist] = {}
        self._recent, self._network_changed = RecentParameters(), False
        self._scene_publisher = self.create_publisher(MarkerArray, f"{names.DRAWN}/{names.SCENE}", STATUS_QOS)
        self._network_publisher = self.create_publisher(MarkerArray, f"{names.DRAWN}/{names.NETWORK}", STATUS_QOS)
        self._consensus = ScalarTopics(self, f"{names.DRAWN}/{names.CONSENSUS}")
        self._scene_publisher.publish(drawings.scene_markers(self._header(), scene))
        self.create_timer(1 / rate, self._draw)

    def _header(self) -> Header:
        return Header(stamp=self.get_clock().now().to_msg(), frame_id=self._frame)

    def watch(self, namespace: str) -> None:
        """Listen to a learner of the experiment, and draw it."""
        name = namespace.rpartition("/")[2]
        if name not in {*self._experiment.learners, *method_names()}:
            return
        super().watch(namespace)
        artist = LearnerArtist(self, self.learners[namespace], self._experiment, self._game, self._scene)
        self.artists[namespace] = artist
        if self._demonstrations and name in self._experiment.learners:
            artist.hear_demonstrations(self._header)

    def _on_message(self, learner: WatchedLearner, what: str) -> None:
        artist = self.artists[learner.namespace]
        artist.changed.add(what)
        if what == "status":
            artist.show_scalars()
        if what in {"status", "parameters"} and artist.fits():  # whichever comes later, to who joins late
            self._recent.note(learner.namespace, learner.parameters)
        self._network_changed = True

    def _draw(self) -> None:
        header = self._header()
        for artist in self.artists.values():
            artist.draw(header)
        if self._network_changed:
            self._network_changed = False
            self._draw_network(header)

    def _draw_network(self, header: Header) -> None:
        schedule = self._experiment.edge_schedule
        statuses = {learner.name: learner.status for learner in self.learners.values()}
        states = edge_states(schedule, statuses)
        markers = drawings.network_markers(header, schedule.learners, states, self._scene.raster)
        self._network_publisher.publish(markers)
        if (consensus := self._recent.consensus()) is not None:
            self._consensus.publish({name: float(value) for name, value in consensus._asdict().items()})
