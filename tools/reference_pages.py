"""Reference pages of the documentation, written from the code while mkdocs builds (a hook, see mkdocs.yml).

Commands come from typer, parameters, topics and QoS from nodes that are created for a moment, messages and services
from their definitions, files from ``run_directory.CONTENTS``; pages of settings are those of ``schema_pages``.
"""

import ast
import os
import re
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from pathlib import Path
from typing import Any, Literal, NamedTuple, get_args, get_origin

import rclpy
import yaml
from markdown_text import block, code, table
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from rclpy.context import Context
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.qos import QoSProfile
from schema_pages import settings_page, studies_page
from typer.main import get_command

from mabirds_bringup import exit_codes
from mabirds_bringup.application import app
from mabirds_bringup.draw.node import DrawingNode
from mabirds_bringup.evaluate.policies import LearnerMetrics
from mabirds_bringup.run.declaration import MembershipPublisher
from mabirds_bringup.run.run_directory import CONTENTS
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_expert_player import player_help, player_node
from mabirds_learner import baseline_node, learner_node
from mabirds_msgs_py import qos, topics
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.environment import prepare_environment
from mabirds_msgs_py.settings_inquiry import SETTINGS

ROOT = Path(__file__).resolve().parents[1]
PATROL = ROOT / "ros_ws" / "config" / "patrol.yaml"
INTERFACES = ROOT / "ros_ws" / "src" / "mabirds_msgs"
OF_EVERY_NODE = re.compile(
    r"/rosout|/parameter_events|use_sim_time|start_type_description_service|rcl_interfaces/.*|type_description_.*/.*"
)
"""Topics, parameters and types of services that ROS gives every node."""


# Commands


def commands_page() -> str:
    """Every verb of ``mabirds`` with its arguments and options, and what the nodes' own commands say."""
    sections = [_command_section(path, command) for path, command in _commands("mabirds", get_command(app))]
    helps = {
        "mabirds-learner": learner_node.HELP,
        "mabirds-baseline": baseline_node.HELP,
        "mabirds-expert-player": player_help.HELP,
    }
    sections += [f"## {name}\n\n{block(text)}" for name, text in helps.items()]
    codes = table(("code", "meaning"), _constants(Path(exit_codes.__file__)))
    return "\n".join(["# Commands", "", *sections, "## Exit codes of mabirds", "", codes])


def _commands(path: str, command: Any) -> Iterator[tuple[str, Any]]:
    verbs = getattr(command, "commands", None)
    if verbs is None or getattr(command, "invoke_without_command", False):
        yield path, command
    for name, verb in (verbs or {}).items():
        yield from _commands(f"{path} {name}", verb)


def _command_section(path: str, command: Any) -> str:
    arguments = [name for option in command.params if (name := _argument(option))]
    usage = " ".join([path, "[OPTIONS]", *arguments])
    about, _, example = str(command.help or "").partition("Example: ")
    rows = [_option_row(option) for option in command.params if option.name != "help"]
    parts = [f"## {path}", about.strip(), block(usage, "console"), table(("option", "default", "meaning"), rows)]
    if example:
        parts.append(f"For example:\n\n{block(example, 'console')}")
    return "\n\n".join(parts) + "\n"


def _argument(option: Any) -> str:
    if option.param_type_name != "argument":
        return ""
    name = option.metavar or option.name.upper()
    return f"{name}{'...' if option.nargs == -1 else ''}"


def _option_row(option: Any) -> tuple[str, str, str]:
    name = _argument(option) or ", ".join(option.opts)
    default = "required" if option.required else _default(option.default)
    return code(name), default, f"{option.help or ''} {_choices(option)}".strip()


def _choices(option: Any) -> str:
    """What may be given, where that is limited: names, or a range."""
    kinds = [option.type_descriptor.annotation, *get_args(option.type_descriptor.annotation)]
    if names := [name for kind in kinds if get_origin(kind) is Literal for name in get_args(kind)]:
        return f"One of {', '.join(map(code, names))}."
    low, high = option.min, option.max
    if low is not None:
        return f"At least {low:g}." if high is None else f"From {low:g} to {high:g}."
    return "" if high is None else f"At most {high:g}."


def _default(value: object) -> str:
    return "" if value is None or value is False or value == "" else code(value)


def _constants(file: Path) -> Iterator[tuple[str, str]]:
    """Values of a module's constants and the strings that follow them."""
    body = ast.parse(file.read_text(encoding="utf-8")).body
    for here, after in zip(body, [*body[1:], None], strict=True):
        if isinstance(here, ast.Assign) and isinstance(here.value, ast.Constant):
            name = ast.unparse(here.targets[0])
            told = isinstance(after, ast.Expr) and isinstance(after.value, ast.Constant)
            words = str(after.value.value) if told else f"{name.capitalize().replace('_', ' ')}."  # type: ignore[union-attr]
            yield code(here.value.value), words


# Parameters, topics and services of nodes


class Described(NamedTuple):
    """What a node declares, publishes, hears, serves and calls."""

    parameters: list[tuple[str, str, str, str]]
    topics: list[tuple[str, str, str, str]]
    services: list[tuple[str, str, str]]


@cache
def nodes() -> dict[str, Described]:
    """All nodes of the patrol experiment by title, described from live instances."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        context = stack.enter_context(_ros(folder))
        resilient = _resilient_copy(folder / "resilient.yaml")
        recording = stack.enter_context(BagWriter(folder / "bag"))

        def drawing() -> Node:
            node = DrawingNode(load_experiment(PATROL), demonstrations=True, context=context)
            node.watch("/learner_1")
            return node

        create: dict[str, Callable[..., Node]] = {
            "Learner in strict mode": lambda: learner(PATROL),
            "Learner in resilient mode": lambda: learner(resilient),
            "Central method": lambda: baseline_node.BaselineNode(namespace="/bics", **_of(PATROL, context)),
            "Expert player": lambda: player_node.ExpertPlayerNode(**_of(PATROL, context)),
            "mabirds run": lambda: MonitorNode(load_experiment(PATROL), recording, context=context),
            "mabirds draw": drawing,
            "mabirds members": lambda: MembershipPublisher(["learner_1", "learner_2"], context=context),
        }

        def learner(file: Path) -> Node:
            return learner_node.LearnerNode(namespace="/learner_1", **_of(file, context))

        return {title: _described(make()) for title, make in create.items()}


@contextmanager
def _ros(folder: Path) -> Iterator[Context]:
    """A context whose nodes nobody finds."""
    os.environ |= {"ROS_AUTOMATIC_DISCOVERY_RANGE": "OFF", "ROS_LOG_DIR": str(folder / "log")}
    prepare_environment()
    context = Context()
    rclpy.init(args=[], context=context)
    yield context
    rclpy.try_shutdown(context=context)


def _resilient_copy(file: Path) -> Path:
    settings = yaml.safe_load(PATROL.read_text(encoding="utf-8"))
    bag = (PATROL.parent / settings["demonstrations"]["bag"]).resolve()
    settings |= {"mixing": {"kind": "resilient"}, "demonstrations": {**settings["demonstrations"], "bag": str(bag)}}
    file.write_text(yaml.safe_dump(settings), encoding="utf-8")
    return file


def _of(file: Path, context: Context) -> dict[str, Any]:
    return {"context": context, "parameter_overrides": [Parameter("experiment", value=str(file))]}


def _described(node: Node) -> Described:
    ends: list[tuple[str, str, Any]] = [("publishes", end.topic_name, end) for end in node.publishers]
    ends += [("hears", end.topic_name, end) for end in node.subscriptions]
    calls: list[tuple[str, str, Any]] = [("serves", end.service_name, end.srv_type) for end in node.services]
    calls += [("calls", end.service_name, end.srv_type) for end in node.clients]
    described = Described(
        list(_parameters(node)),
        [
            (way, code(_general(name)), _type_name(end.msg_type), _qos(end.qos_profile))
            for way, name, end in ends
            if _own(name)
        ],
        [(way, code(_general(name)), _type_name(kind)) for way, name, kind in calls if _own(_type_name(kind))],
    )
    node.destroy_node()
    return described


def _own(name: str) -> bool:
    return OF_EVERY_NODE.fullmatch(name.strip("`")) is None


def _general(name: str) -> str:
    """The patrol experiment's names stand for all: learner_1 is any learner, learner_2 a neighbour."""
    return name.replace("bics", "METHOD")


def _type_name(kind: type) -> str:
    return code(f"{kind.__module__.split('.')[0]}/{kind.__name__}")


def _qos(profile: QoSProfile) -> str:
    words = [profile.reliability.name.lower(), profile.durability.name.lower().replace("_", " "), str(profile.depth)]
    lease = profile.liveliness_lease_duration.nanoseconds / 1e9
    return ", ".join([*words, *([f"lease {lease:g} s"] if 0 < lease < 1e6 else [])])


def _parameters(node: Node) -> Iterator[tuple[str, str, str, str]]:
    for name in sorted(filter(_own, node.get_parameters_by_prefix(""))):
        about, value = node.describe_parameter(name), node.get_parameter_or(name, Parameter(name)).value
        limits = [
            f"{bounds.from_value:g} to {bounds.to_value:g}"
            for bounds in (*about.integer_range, *about.floating_point_range)
        ]
        shown = "" if value is None else code(str(value).lower() if isinstance(value, bool) else value)
        default = {"experiment": "required", SETTINGS: "those of the experiment"}.get(name, shown)
        change = "" if about.read_only else "; may change while the node runs"
        yield code(name), default, ", ".join(limits), about.description + change


def parameters_page() -> str:
    """ROS parameters of every node that has any; nodes with the same ones together."""
    head, titles = ("parameter", "default", "range", "meaning"), dict[str, list[str]]()
    for title, node in nodes().items():
        if node.parameters:
            titles.setdefault(table(head, node.parameters), []).append(title)
    sections = [f"## {' and '.join(names)}\n\n{rows}" for rows, names in titles.items()]
    return "\n".join(["# Parameters of nodes", "", "Set one by `--ros-args -p NAME:=VALUE`.", "", *sections])


def topics_page() -> str:
    """Topics with their QoS, and services, of every node."""
    words = (
        f"Names and QoS as the nodes of `{PATROL.relative_to(ROOT)}` have them, seen from `/learner_1`, whose neighbour"
        " is `learner_2`. QoS: reliability, durability, depth; lease: after how many seconds of silence a process"
        f" counts as gone ({qos.LIVELINESS_LEASE:g}). Every node also has ROS's own `/rosout` and `/parameter_events`."
        f" Names are made in `{topics.__name__}`."
    )
    parts = ["# Topics and services", "", words, ""]
    for title, node in nodes().items():
        parts += [f"## {title}", "", table(("", "topic", "type", "QoS"), node.topics)]
        if node.services:
            parts.append(table(("", "service", "type"), node.services))
    return "\n".join(parts)


def messages_page() -> str:
    """The text of every message and service."""
    files = [*sorted(INTERFACES.glob("msg/*.msg")), *sorted(INTERFACES.glob("srv/*.srv"))]
    sections = [f"## {file.stem}\n\n{block(file.read_text(encoding='utf-8'))}" for file in files]
    return "\n".join(["# Messages and services", "", "The package is `mabirds_msgs`.", "", *sections])


# Files


def files_page() -> str:
    """What a run leaves behind."""
    contents = table(("file", "content"), ((code(name), words) for name, words in CONTENTS.items()))
    fields = LearnerMetrics.__dataclass_fields__
    columns = table(("column", "type"), ((code(name), code(_name(field.type))) for name, field in fields.items()))
    experiment = (
        "Read: the experiment file ([its settings](settings.md)) and the bag that it names, a rosbag2 directory."
    )
    written = "Written: a run directory, `runs/TIME-NAME`; `runs/latest` points to the newest."
    head = [
        "# Files",
        "",
        experiment,
        "",
        written,
        "",
        contents,
        f"## metrics.csv\n\n{LearnerMetrics.__doc__}\n",
        columns,
    ]
    return "\n".join(head)


def _name(kind: Any) -> str:
    return getattr(kind, "__name__", str(kind))


PAGES: dict[str, Callable[[], str]] = {
    "commands": commands_page,
    "settings": settings_page,
    "studies": studies_page,
    "parameters": parameters_page,
    "topics": topics_page,
    "messages": messages_page,
    "files": files_page,
}


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages to those of docs/."""
    for name, page in PAGES.items():
        files.append(File.generated(config, f"reference/{name}.md", content=page()))
    return files
