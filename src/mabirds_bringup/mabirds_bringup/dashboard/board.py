"""What a page shows: heard by a node in a thread of its own, handed on as a snapshot that nobody changes."""

import queue
import threading
import time
from collections import defaultdict, deque
from contextlib import closing, suppress
from dataclasses import dataclass, field
from typing import Any, Literal

from mabirds_msgs.msg import PlayerStatus
from rclpy.client import Client
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor

from mabirds_bringup.draw.imagined import Imagination
from mabirds_bringup.watch.described import describe
from mabirds_bringup.watch.edges import EdgeState, edge_states
from mabirds_bringup.watch.inspector import InspectorNode, WatchedLearner
from mabirds_bringup.watch.recent import Consensus, RecentParameters
from mabirds_bringup.watch.spinning import Glances
from mabirds_core.arrays import Array
from mabirds_core.consensus.weights import Edge
from mabirds_core.costs.models import costs_of
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.scene import Scene, scene_of
from mabirds_msgs_py.conversion import arrays
from mabirds_msgs_py.player_services import service_type

PERIOD = 0.5
"""Seconds between two snapshots."""

POINTS = 2000
"""Of a curve; older ones are dropped."""

PATHS = 3
"""Imagined trajectories that are shown."""

Control = Literal["toggle_paused", "play_next", "set_rate"]
"""Services of the player that a page calls."""

NATS = "held_out_log_likelihood"


@dataclass(frozen=True)
class LearnerView:
    """What is shown of a learner: ``costs`` and ``paths`` as of its scene, by expert."""

    name: str
    content: dict[str, Any]
    costs: Array | None
    paths: Array | None


@dataclass(frozen=True)
class Snapshot:
    """What is known at one time. ``curves[name][learner]``: pairs of iteration and value."""

    learners: tuple[LearnerView, ...] = ()
    player: PlayerStatus | None = None
    player_name: str = ""
    edges: dict[Edge, EdgeState] = field(default_factory=dict)
    consensus: Consensus | None = None
    curves: dict[str, dict[str, list[tuple[int, float]]]] = field(default_factory=dict)


class Board:
    """Listens to an experiment's network; ``snapshot`` is the newest, ``ask`` calls a service of the player.

    ``node_options``: as of ``rclpy.node.Node``.
    """

    def __init__(self, experiment: Experiment, **node_options: Any) -> None:
        self.experiment, self.game = experiment, build_game(experiment)
        self.scene: Scene | None = scene_of(self.game)
        self.snapshot, self.answer = Snapshot(), ""
        self._recent, self._requests = RecentParameters(), queue.Queue[tuple[Control, dict[str, Any]]]()
        self._curves: defaultdict[str, defaultdict[str, deque[tuple[int, float]]]] = defaultdict(
            lambda: defaultdict(lambda: deque(maxlen=POINTS))
        )
        self._imaginations: dict[str, Imagination] = {}
        self._paths: dict[str, Array] = {}
        self._node = InspectorNode(self._on_message, name="dashboard", **node_options)
        self._clients: dict[str, Client] = {}
        self._executor = SingleThreadedExecutor(context=self._node.context)
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)

    def start(self) -> None:
        """Begin to listen."""
        self._thread.start()

    def stop(self) -> None:
        """End listening."""
        self._stopping.set()
        self._thread.join(timeout=10)
        self._executor.shutdown()
        self._node.destroy_node()

    def ask(self, service: Control, **fields: Any) -> None:
        """Have a service of the player called; what it does is seen in its status."""
        self._requests.put((service, fields))

    def _run(self) -> None:
        shown, glances = 0.0, Glances(self._node, self._executor)
        with closing(glances), suppress(ExternalShutdownException):
            while not self._stopping.is_set():
                glances.glance()
                self._call()
                if time.monotonic() - shown > PERIOD:
                    shown = time.monotonic()
                    self.snapshot = self._look()

    def _call(self) -> None:
        """Send what was asked for, to the player that is heard."""
        while not self._requests.empty():
            service, fields = self._requests.get()
            player = next(iter(self._node.players), None)
            if player is None:
                self.answer = "no player is heard"
                continue
            place = f"{player.rpartition('/')[0]}/{service}"
            known = dict(self._node.get_service_names_and_types()).get(place, [])
            if not known:
                self.answer = f"nobody serves {place}"
                continue
            kind = service_type(service, known[0].partition("/")[0])
            if place not in self._clients:
                self._clients[place] = self._node.create_client(kind, place)
            self._clients[place].call_async(kind.Request(**fields))

    def _on_message(self, learner: WatchedLearner, what: str) -> None:
        if what == "parameters" and learner.parameters is not None:
            self._recent.note(learner.namespace, learner.parameters)
            if (consensus := self._recent.consensus()) is not None:
                self._note("consensus", "theta", consensus.iteration, consensus.theta)
                self._note("consensus", "omega", consensus.iteration, consensus.omega)
        elif what == "status" and learner.status is not None:
            status = learner.status
            metrics = dict(zip(status.metric_names, status.metric_values, strict=False))
            self._note("backlog", learner.name, status.iteration, status.backlog)
            if NATS in metrics:
                self._note("nats", learner.name, status.iteration, metrics[NATS])

    def _note(self, curve: str, name: str, iteration: int, value: float) -> None:
        """A point; of several of one iteration the newest."""
        points = self._curves[curve][name]
        if points and points[-1][0] == iteration:
            points.pop()
        points.append((int(iteration), float(value)))

    def _look(self) -> Snapshot:
        learners = [learner for _, learner in sorted(self._node.learners.items())]
        schedule = next((edges for learner in learners if (edges := learner.edges) is not None), None)
        statuses = {learner.name: learner.status for learner in learners}
        player_name = next(iter(self._node.players), "")
        return Snapshot(
            tuple(self._view(learner) for learner in learners),
            self._node.players.get(player_name),
            player_name.rpartition("/")[0],
            edge_states(schedule, statuses) if schedule is not None else {},
            self._recent.consensus(),
            {curve: {name: list(points) for name, points in of.items()} for curve, of in self._curves.items()},
        )

    def _view(self, learner: WatchedLearner) -> LearnerView:
        content, costs = describe(learner, 5), None
        if self.scene is not None and self._fits(learner):
            parameters = arrays(learner.parameters)
            costs = self.scene.costs(parameters.omega)
            imagination = self._imaginations.get(learner.name)
            if imagination is None:
                imagination = Imagination(self.experiment, learner.name, self.game, self.scene)
                self._imaginations[learner.name] = imagination
            if (places := imagination.places(parameters, PATHS)) is not None:
                self._paths[learner.name] = places
        return LearnerView(learner.name, content, costs, self._paths.get(learner.name))

    def _fits(self, learner: WatchedLearner) -> bool:
        """Does it learn this experiment's game?"""
        status, message = learner.status, learner.parameters
        if status is None or message is None or status.game_digest != self.game.digest:
            return False
        return len(message.omega) == costs_of(self.game).size
