"""Who may say and hear what, one process each: an experiment's access-control policy in SROS2's format.

A learner's rights follow from the edge schedule: it hears its scheduled in-neighbours and nobody else. What every
process needs to be a ROS node stands in NODE_TOPICS and NODE_SERVICES. Names are exact, but for ``drawn/*`` of a
learner, where drawings alone publish: which numbers a status has is known once it is heard.
"""

from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import get_args
from xml.etree import ElementTree as ET

from rclpy.exceptions import InvalidNamespaceException
from rclpy.validate_namespace import validate_namespace

from mabirds_bringup.dashboard.board import Control
from mabirds_bringup.draw import names as drawn
from mabirds_bringup.watch.recent import Consensus
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py import player_services, topics
from mabirds_msgs_py.security import SecurityError

POLICY_VERSION = "0.2.0"
"""Version of SROS2's policy format, as ROS 2 Jazzy reads it."""

NODE_TOPICS = ("/parameter_events", "/rosout")
"""What every node publishes."""

PARAMETER_SERVICES = (
    "describe_parameters",
    "get_parameter_types",
    "get_parameters",
    "list_parameters",
    "set_parameters",
    "set_parameters_atomically",
)

NODE_SERVICES = (*PARAMETER_SERVICES, "get_type_description")
"""What every node serves below its own name."""

PLAYER = "expert_player"
SERVED = (*player_services.PLAYER_SERVICES, player_services.RESEND)

LEARNING_NODES = ("learner", "baseline")
"""Nodes that have a namespace for themselves."""


@dataclass(frozen=True)
class Access:
    """What one process may do. Names of topics and services are fully qualified: /learner_1/parameters.

    ``reply``: services it serves; ``request``: services it calls; as SROS2 says it.
    """

    enclave: str
    namespace: str
    node: str
    publish: tuple[str, ...]
    subscribe: tuple[str, ...]
    reply: tuple[str, ...]
    request: tuple[str, ...]


@dataclass(frozen=True)
class Policy:
    """The policy of an experiment whose processes all run below the namespace ``fleet``.

    ``method``: a central method that learns in the learners' place, from the demonstrations of all of them.
    """

    experiment: Experiment
    fleet: str = "/"
    method: str | None = None

    def __post_init__(self) -> None:
        """Raise SecurityError for a fleet that is no namespace."""
        try:
            validate_namespace(self.fleet)
        except InvalidNamespaceException as error:
            raise SecurityError(f"namespace {self.fleet!r}: expected one such as /depot ({error})") from None

    def processes(self) -> tuple[Access, ...]:
        """All processes of the network; raises SecurityError where two would share an enclave."""
        learning = [self._baseline(self.method)] if self.method else map(self._learner, self.experiment.learners)
        processes = (*learning, self._player(), *self._people())
        counts = Counter(process.enclave for process in processes)
        if shared := [enclave for enclave, count in counts.items() if count > 1]:
            raise SecurityError(f"enclave {shared[0]}: taken by another process; give the learner another name")
        return processes

    def _learner(self, name: str) -> Access:
        publish, subscribe, request = self._exchange(name)
        return _access(
            self._of(name),
            "learner",
            publish=[*self._published_by(name), *publish],
            subscribe=[self._of(name, topics.DEMONSTRATION), *subscribe],
            reply=[self._of(name, topics.FETCH_PARAMETERS)],
            request=request,
        )

    def _exchange(self, name: str) -> tuple[list[str], list[str], list[str]]:
        """What a learner publishes, hears and calls to mix with scheduled neighbours: all that its mode decides."""
        schedule = self.experiment.edge_schedule
        edges = [(schedule.learners[sender], schedule.learners[receiver]) for sender, receiver in schedule.all_edges]
        senders = [sender for sender, receiver in edges if receiver == name]
        if self.experiment.mixing.declares_members:
            given = [self._of(name, topics.mass(receiver)) for sender, receiver in edges if sender == name]
            taken = self._each(senders, topics.mass(name))
            return given, [*taken, self._of(topics.MEMBERSHIP)], []
        return [], self._each(senders, topics.PARAMETERS), self._each(senders, topics.FETCH_PARAMETERS)

    def _baseline(self, method: str) -> Access:
        demonstrations = self._each(self.experiment.learners, topics.DEMONSTRATION)
        published = [name for name in self._published_by(method) if name != self._of(method, topics.CONSTRAINTS)]
        return _access(self._of(method), "baseline", publish=published, subscribe=demonstrations)

    def _player(self) -> Access:
        return _access(
            self.fleet,
            PLAYER,
            publish=[
                topics.DIAGNOSTICS,
                "/clock",
                self._of(PLAYER, player_services.STATUS),
                *self._each(self.experiment.learners, topics.DEMONSTRATION),
            ],
            subscribe=self._each(self._learning, topics.STATUS),
            reply=[self._of(PLAYER, service) for service in SERVED],
        )

    def _people(self) -> Iterator[Access]:
        """Who watches the network, and in resilient mode declares its members."""
        declared = [self._of(topics.MEMBERSHIP)] if self._has_members else []
        missed = self._each(self._learning, topics.FETCH_PARAMETERS)
        called = [self._of(PLAYER, service) for service in player_services.PLAYER_SERVICES]
        heard = [self._of(PLAYER, player_services.STATUS)]
        watched = [*self._watched(), *heard]
        yield _access("/", "monitor", publish=declared, subscribe=[*watched, *declared], request=missed)
        yield _access("/", "inspector", subscribe=[*watched, *self._drawn(drawn.COSTS)])
        yield from self._showing(watched)
        yield _access(self.fleet, "player_client", subscribe=heard, request=called)
        if self._has_members:
            heard = self._each(self._learning, topics.STATUS)
            yield _access(self.fleet, "declarer", publish=declared, subscribe=heard)

    def _showing(self, watched: list[str]) -> Iterator[Access]:
        """The page, drawings, and who makes pictures of them."""
        controls = [self._of(PLAYER, service) for service in get_args(Control)]
        yield _access("/", "dashboard", subscribe=watched, request=controls)
        scene, network, consensus = (f"/{drawn.DRAWN}/{name}" for name in (drawn.SCENE, drawn.NETWORK, drawn.CONSENSUS))
        numbers = [f"{consensus}/{part}" for part in Consensus._fields if len(self._learning) > 1]
        yield _access("/", "drawing", publish=[scene, network, *numbers, *self._drawn()], subscribe=watched)
        yield _access("/", "picture", subscribe=[scene, network, *self._drawn()])

    def _drawn(self, *kind: str) -> list[str]:
        """All that is drawn of learners, or all of a kind."""
        return [drawn.of_learner(self._of(name), *kind, "*") for name in self._learning]

    @property
    def _has_members(self) -> bool:
        return self.experiment.mixing.declares_members and not self.method

    @property
    def _learning(self) -> tuple[str, ...]:
        return (self.method,) if self.method else self.experiment.learners

    def _published_by(self, name: str) -> list[str]:
        """What a learner or central method publishes."""
        return [topics.DIAGNOSTICS, *(self._of(name, topic) for topic in self._shown())]

    def _watched(self) -> list[str]:
        """What people who watch the network hear."""
        return [name for topic in self._shown() for name in self._each(self._learning, topic)]

    @staticmethod
    def _shown() -> tuple[str, ...]:
        return topics.PARAMETERS, topics.STATUS, topics.CONSTRAINTS, topics.EDGE_SCHEDULE, topics.FEATURE_NAMES

    def _each(self, owners: Iterable[str], name: str) -> list[str]:
        return [self._of(owner, name) for owner in owners]

    def _of(self, *parts: str) -> str:
        """A fully qualified name in the fleet: of a namespace, a topic or a service."""
        return "/".join([self.fleet.rstrip("/"), *parts])


def _access(
    namespace: str,
    node: str,
    *,
    publish: Iterable[str] = (),
    subscribe: Iterable[str] = (),
    reply: Iterable[str] = (),
    request: Iterable[str] = (),
) -> Access:
    """What a node may do, with what every node may do added.

    The enclave of a learner is its namespace; those who share a namespace have their node's full name.
    """
    full_name = f"{namespace.rstrip('/')}/{node}"
    return Access(
        enclave=namespace if node in LEARNING_NODES else full_name,
        namespace=namespace,
        node=node,
        publish=tuple(sorted([*publish, *NODE_TOPICS])),
        subscribe=tuple(sorted(subscribe)),
        reply=tuple(sorted([*reply, *(f"{full_name}/{service}" for service in NODE_SERVICES)])),
        request=tuple(sorted(request)),
    )


def policy_xml(processes: Iterable[Access]) -> str:
    """The policy file for SROS2, one enclave per process."""
    policy = ET.Element("policy", version=POLICY_VERSION)
    enclaves = ET.SubElement(policy, "enclaves")
    for process in processes:
        profiles = ET.SubElement(ET.SubElement(enclaves, "enclave", path=process.enclave), "profiles")
        profile = ET.SubElement(profiles, "profile", ns=process.namespace, node=process.node)
        for kind, right, names in _rights(process):
            allowed = ET.SubElement(profile, f"{kind}s", {right: "ALLOW"})
            for name in names:
                ET.SubElement(allowed, kind).text = name
    ET.indent(policy)
    return ET.tostring(policy, encoding="UTF-8", xml_declaration=True).decode() + "\n"


def _rights(process: Access) -> Iterator[tuple[str, str, tuple[str, ...]]]:
    """Kind of name, right and names, as SROS2's policies group them; only where there are names."""
    for kind, right in (("topic", "publish"), ("topic", "subscribe"), ("service", "reply"), ("service", "request")):
        names = getattr(process, right)
        if names:
            yield kind, right, names
