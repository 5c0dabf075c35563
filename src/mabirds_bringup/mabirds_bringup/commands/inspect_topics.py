"""``mabirds inspect list | echo | hz | bw | info | param | call``: any topic, parameter and service."""

import csv
import json
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from itertools import islice, pairwise
from typing import Annotated, Any, Literal, NamedTuple

import typer
import yaml

from mabirds_bringup.commands.options import Json
from mabirds_bringup.console import console, ending_as_interrupted, guarded_output, print_json
from mabirds_bringup.topics.listening import Listening, listener_node
from mabirds_bringup.topics.parameters import Services
from mabirds_bringup.topics.plain import field_of, flat, named, plain
from mabirds_bringup.watch.spinning import looking

Topic = Annotated[str, typer.Argument(metavar="TOPIC", help="Full name, such as /learner_1/parameters.")]
NodeName = Annotated[str, typer.Argument(metavar="NODE", help="Full name, such as /learner_1/learner.")]
Timeout = Annotated[float, typer.Option(help="Seconds to look for it.", min=0.1)]
Seconds = Annotated[float, typer.Option(help="Seconds to listen.", min=0.1)]

DISCOVERY = 2.0
"""Seconds after which the lists of topics and services are taken to be whole."""


class Look(NamedTuple):
    """What a command looks with, and where its data go."""

    node: Any
    listening: Listening
    stream: Any

    def show(self, content: Any, *, as_json: bool) -> None:
        """Print data."""
        if as_json:
            print_json(content, self.stream)
        else:
            text = content if isinstance(content, str) else yaml.safe_dump(content, sort_keys=False, allow_unicode=True)
            print(text.rstrip("\n"), file=self.stream, flush=True)


@contextmanager
def _look(timeout: float) -> Iterator[Look]:
    """ROS for as long as a command looks; who reads its output may go at any time, as `head` does."""
    with (
        suppress(KeyboardInterrupt, BrokenPipeError),
        guarded_output() as stream,
        ending_as_interrupted(),
        looking(listener_node, "/inspector") as (node, executor),
    ):
        yield Look(node, Listening(node, executor, timeout), stream)


def list_(
    services: Annotated[bool, typer.Option("--services", help="Services, not topics.")] = False,
    nodes: Annotated[bool, typer.Option("--nodes", help="Nodes, not topics.")] = False,
    as_json: Json = False,
) -> None:
    """List topics, services or nodes with their types.

    Example: mabirds inspect list --json
    """
    with _look(DISCOVERY) as look:
        look.listening.spin_until(lambda: False)
        own = f"{look.node.get_namespace().rstrip('/')}/{look.node.get_name()}"
        if nodes:
            content = {f"{place.rstrip('/')}/{name}": "" for name, place in look.node.get_node_names_and_namespaces()}
        else:
            known = look.node.get_service_names_and_types() if services else look.node.get_topic_names_and_types()
            content = {name: types[0] for name, types in known}
        content = {name: kind for name, kind in sorted(content.items()) if not name.startswith(own)}
        lines = "\n".join(f"{name} {kind}".strip() for name, kind in content.items())
        look.show(content if as_json else lines, as_json=as_json)


def echo(
    topic: Topic,
    once: Annotated[bool, typer.Option("--once", help="The newest message, then end.")] = False,
    field: Annotated[str, typer.Option(help="Part of it, such as omega, or metric_values.0.")] = "",
    count: Annotated[int | None, typer.Option(help="End after so many messages.", min=1)] = None,
    form: Annotated[Literal["yaml", "jsonl", "csv"], typer.Option("--format", help="How to print.")] = "yaml",
    timeout: Timeout = 10.0,
) -> None:
    """Print the messages of a topic; theta and omega by name.

    Example: mabirds inspect echo /learner_1/parameters --once --field omega --format csv
    """
    with _look(timeout) as look:
        names = look.listening.names_for(topic)
        messages = iter([look.listening.newest(topic)]) if once else look.listening.messages(topic)
        table = csv.writer(look.stream, lineterminator="\n")
        for number, message in enumerate(islice(messages, count)):
            content = field_of(named(plain(message), names), field)
            if form == "csv":
                _write_csv(table, dict(flat(content)), header=number == 0)
                look.stream.flush()
            elif form == "jsonl":
                print_json(content, look.stream)
            else:
                look.show(content if isinstance(content, dict | list) else json.dumps(content), as_json=False)
                print("---", file=look.stream, flush=True)


def _write_csv(table: Any, values: dict[str, Any], *, header: bool) -> None:
    if header:
        table.writerow(values)
    table.writerow(values.values())


def hz(topic: Topic, seconds: Seconds = 5.0, timeout: Timeout = 10.0, as_json: Json = False) -> None:
    """Messages per second, and the time between two of them.

    Example: mabirds inspect hz /learner_1/status --seconds 10
    """
    with _look(timeout) as look:
        times, _ = _measure(look, topic, seconds)
        gaps = [later - earlier for earlier, later in pairwise(times)]
        rate = len(gaps) / (times[-1] - times[0]) if gaps else 0.0
        content = {"topic": topic, "messages": len(times), "hz": rate}
        content |= {"shortest_gap": min(gaps), "longest_gap": max(gaps)} if gaps else {}
        look.show(content, as_json=as_json)


def bw(topic: Topic, seconds: Seconds = 5.0, timeout: Timeout = 10.0, as_json: Json = False) -> None:
    """Bytes per second of messages as they are serialised, without the middleware's headers.

    Example: mabirds inspect bw /learner_1/parameters
    """
    with _look(timeout) as look:
        times, sizes = _measure(look, topic, seconds)
        mean = sum(sizes) / len(sizes) if sizes else 0.0
        content = {"topic": topic, "messages": len(times), "bytes_per_second": sum(sizes) / seconds, "mean_bytes": mean}
        look.show(content, as_json=as_json)


def _measure(look: Look, topic: str, seconds: float) -> tuple[list[float], list[int]]:
    """When messages came, and how large they were; those that publishers keep do not count."""
    came: list[tuple[float, int]] = []
    look.listening.subscribe(topic, lambda data: came.append((time.monotonic(), len(data))), raw=True)
    look.listening.spin_until(lambda: False, 0.5)
    came.clear()
    look.listening.spin_until(lambda: False, seconds)
    return [moment for moment, _ in came], [size for _, size in came]


def info(topic: Topic, timeout: Timeout = 10.0, as_json: Json = False) -> None:
    """Type of a topic, who publishes and hears it, and with which QoS.

    Example: mabirds inspect info /learner_1/status
    """
    with _look(timeout) as look:
        content: dict[str, Any] = {"topic": topic, "type": look.listening.type_of(topic)}
        look.listening.spin_until(lambda: False, DISCOVERY)  # who is behind an end is known a little later
        for side, infos in (
            ("publishers", look.node.get_publishers_info_by_topic(topic)),
            ("subscribers", look.node.get_subscriptions_info_by_topic(topic)),
        ):
            content[side] = [_end(of_one) for of_one in infos]
        look.show(content, as_json=as_json)


def _end(of_one: Any) -> dict[str, str]:
    profile = of_one.qos_profile
    return {
        "node": f"{of_one.node_namespace.rstrip('/')}/{of_one.node_name}",
        "reliability": profile.reliability.name.lower(),
        "durability": profile.durability.name.lower(),
    }


param_app = typer.Typer(help="Get, set and dump parameters of nodes.", add_completion=False)


@param_app.command("get")
def param_get(node: NodeName, name: str, timeout: Timeout = 10.0, as_json: Json = False) -> None:
    """Value of a parameter.

    Example: mabirds inspect param get /expert_player rate
    """
    with _look(timeout) as look:
        content = Services(look.node, look.listening).get(node, [name])
        look.show(content if as_json else json.dumps(content[name]), as_json=as_json)


@param_app.command("set")
def param_set(node: NodeName, name: str, value: str, timeout: Timeout = 10.0) -> None:
    """Set a parameter that may change while the node runs.

    Example: mabirds inspect param set /expert_player rate 20.0
    """
    with _look(timeout) as look:
        shown = Services(look.node, look.listening).set(node, name, value)
        console.print(f"{node} {name}: {shown}", soft_wrap=True)


@param_app.command("dump")
def param_dump(node: NodeName, timeout: Timeout = 10.0, as_json: Json = False) -> None:
    """All parameters of a node, as a file of parameters, or as JSON.

    Example: mabirds inspect param dump /learner_1/learner
    """
    with _look(timeout) as look:
        values = Services(look.node, look.listening).dump(node)
        look.show(values if as_json else {node: {"ros__parameters": values}}, as_json=as_json)


def call(
    service: Annotated[str, typer.Argument(metavar="SERVICE", help="Full name, such as /expert_player/set_rate.")],
    request: Annotated[str, typer.Argument(metavar="[REQUEST]", help="Its fields in YAML.")] = "",
    timeout: Timeout = 10.0,
    as_json: Json = False,
) -> None:
    """Call a service.

    Example: mabirds inspect call /expert_player/set_rate '{rate: 2.0}'
    """
    with _look(timeout) as look:
        look.show(Services(look.node, look.listening).call_by_name(service, request), as_json=as_json)
