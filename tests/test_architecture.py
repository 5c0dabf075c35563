"""Who may import whom, what a learner's process does not load, and how long a file may be."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import networkx as nx
import pytest

SOURCES = Path(__file__).resolve().parents[1] / "src"

MAY_IMPORT = {
    "mabirds_core": set[str](),
    "mabirds_msgs_py": {"mabirds_core"},
    "mabirds_expert_player": {"mabirds_core", "mabirds_msgs_py"},
    "mabirds_learner": {"mabirds_core", "mabirds_msgs_py"},
    "mabirds_bringup": {"mabirds_core", "mabirds_msgs_py", "mabirds_expert_player", "mabirds_learner"},
}
"""core <- msgs_py <- {expert_player, learner} <- bringup; each may import itself as well."""

ROS = re.compile(r"rclpy|rcl_.*|ros.*|ament_.*|launch.*|mcap|.*_msgs|.*_interfaces|.*_srvs")
"""Root modules that come with ROS or with its files."""

MAX_FILE = 350


def modules(package: str) -> list[Path]:
    return sorted((SOURCES / package / package).rglob("*.py"))


def text(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def imported_roots(source: str) -> Iterator[str]:
    """The first part of every absolutely imported module, inside functions too."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
            yield node.module.partition(".")[0]


def against_the_arrow(package: str, source: str) -> set[str]:
    """Packages of this repository that the source imports and may not."""
    return set(imported_roots(source)) & set(MAY_IMPORT) - MAY_IMPORT[package] - {package}


def of_ros(source: str) -> set[str]:
    return {root for root in imported_roots(source) if ROS.fullmatch(root)}


def test_every_package_of_the_sources_has_its_place_in_the_order() -> None:
    assert {path.name for path in SOURCES.iterdir() if path.is_dir()} == set(MAY_IMPORT)
    assert all(len(modules(package)) > 1 for package in MAY_IMPORT)


@pytest.mark.parametrize("package", MAY_IMPORT)
def test_no_module_imports_against_the_arrow(package: str) -> None:
    wrong = {path.name: against_the_arrow(package, text(path)) for path in modules(package)}
    assert {name: roots for name, roots in wrong.items() if roots} == {}


def test_core_imports_no_ros() -> None:
    found = {path.name: of_ros(text(path)) for path in modules("mabirds_core")}
    assert {name: roots for name, roots in found.items() if roots} == {}


@pytest.mark.parametrize(
    "line",
    [
        "import mabirds_learner.learner_session",
        "from mabirds_learner import learner_session",
        "def f():\n  import mabirds_learner",
    ],
)
def test_an_import_against_the_arrow_is_seen(line: str) -> None:
    for package in ("mabirds_core", "mabirds_msgs_py", "mabirds_expert_player"):
        assert against_the_arrow(package, line) == {"mabirds_learner"}
    assert against_the_arrow("mabirds_bringup", line) == set()


@pytest.mark.parametrize("root", ["rclpy", "mabirds_msgs", "nav_msgs", "rosbags", "rcl_interfaces", "mcap"])
def test_an_import_of_ros_is_seen(root: str) -> None:
    assert of_ros(f"from {root}.sub import x") == {root}
    assert of_ros("import numpy\nimport yaml\nfrom pydantic import BaseModel\nimport mabirds_core") == set()


def loaded_by(statement: str) -> set[str]:
    """Root modules in sys.modules of a fresh process after the statement."""
    program = f"{statement}\nimport sys\nprint(*sorted({{name.partition('.')[0] for name in sys.modules}}))"
    command = [sys.executable, "-c", program]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    return set(done.stdout.split())


def imports_within(package: str) -> dict[str, set[str]]:
    """By module the modules of the same package that it imports, be it inside functions or for type checkers alone."""
    found = dict[str, set[str]]()
    for path in modules(package):
        nodes = [node for node in ast.walk(ast.parse(text(path))) if isinstance(node, ast.ImportFrom)]
        found[path.stem] = {(node.module or "").removeprefix(f"{package}.") for node in nodes}
    return {name: imported & found.keys() for name, imported in found.items()}


def test_a_learners_process_does_not_load_what_it_does_not_need() -> None:
    loaded = loaded_by("import mabirds_learner.learner_node")
    assert {"mabirds_learner", "mabirds_core", "rclpy", "numpy"} <= loaded
    assert loaded.isdisjoint({"torch", "matplotlib", "rosbags", "scipy", "networkx", "typer", "rich"})
    assert loaded.isdisjoint({"polars", "jinja2", "cryptography", "mcap", "unittest", "xml", "difflib", "lark"})
    assert loaded.isdisjoint({"mabirds_bringup", "mabirds_expert_player"})


OF_OTHERS = (
    "mabirds_core.baselines.bics",
    "mabirds_core.baselines.interface",
    "mabirds_core.costs.network",
    "mabirds_core.games.drones",
    "mabirds_core.games.patrol.held_out",
    "mabirds_core.games.patrol.scene",
    "mabirds_core.games.tabular.experts",
    "mabirds_core.games.tabular.judge",
    "mabirds_core.planners.soft_q_learning",
    "mabirds_learner.push_sum_exchange",
    "mabirds_msgs_py.mass_conversion",
)
"""Parts of reports, players, central methods, other games and other modes."""


def test_a_learner_that_is_ready_has_loaded_nothing_of_others() -> None:
    file = SOURCES.parent / "ros_ws" / "config" / "patrol.yaml"
    program = f"""
import sys
from pathlib import Path
import mabirds_learner.learner_node
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import load_experiment
build_learner(load_experiment(Path({str(file)!r})), "learner_1")
print(*sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True)
    loaded = set(done.stdout.split())
    assert {"mabirds_learner.strict_exchange", "mabirds_core.games.patrol.game"} <= loaded
    assert loaded.isdisjoint(OF_OTHERS)


def test_an_experiment_loads_the_modules_of_its_own_game_alone() -> None:
    file = SOURCES.parent / "ros_ws" / "config" / "patrol.yaml"
    program = f"""
import sys
from pathlib import Path
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import load_experiment
build_learner(load_experiment(Path({str(file)!r})), "learner_1")
games = {{name.split(".")[2:4] and ".".join(name.split(".")[2:4]) for name in sys.modules if ".games." in name}}
print(*sorted(games))
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=120, check=True)
    games = set(done.stdout.split())
    assert {"patrol.game", "patrol.settings"} <= games
    assert {name for name in games if name.startswith("drones.")} == set()


def test_core_loads_without_ros() -> None:
    statements = (
        f"import {'.'.join(path.relative_to(SOURCES / 'mabirds_core').with_suffix('').parts)}"
        for path in modules("mabirds_core")
        if path.name != "__init__.py"
    )
    loaded = loaded_by("\n".join(statements))
    assert "mabirds_core" in loaded
    assert {root for root in loaded if root.startswith(("rcl", "mabirds_msgs", "mabirds_learner"))} == set()


def test_no_source_file_is_longer_than_can_be_read_in_one_go() -> None:
    lengths = {str(path.relative_to(SOURCES)): len(text(path).splitlines()) for path in SOURCES.rglob("*.py")}
    assert {name: length for name, length in lengths.items() if length > MAX_FILE} == {}


def test_sessions_need_no_ros_at_all() -> None:
    absent = {"rclpy", "mabirds_msgs", "builtin_interfaces"}
    hide = f"import sys\nfor name in {sorted(absent)}: sys.modules[name] = None"
    sessions = ("learner_session", "strict_member", "push_sum_member", "baseline_session", "checkpoint")
    loaded = loaded_by("\n".join([hide, *(f"import mabirds_learner.{name}" for name in sessions)]))
    assert {root for root in loaded - loaded_by("") if ROS.fullmatch(root)} == absent


def names_in(package: str) -> dict[str, Path]:
    """Modules of a package by their dotted names."""
    root = SOURCES / package
    files = {path: path.relative_to(root).with_suffix("").parts for path in modules(package)}
    return {".".join(parts[:-1] if parts[-1] == "__init__" else parts): path for path, parts in files.items()}


def imports_of(source: str, known: set[str]) -> set[str]:
    """The known modules that a source imports, wherever it does."""
    imported = set[str]()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            imported |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            imported |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return imported & known


def circles(graph: dict[str, set[str]]) -> list[set[str]]:
    components = nx.strongly_connected_components(nx.DiGraph(graph))
    return [component for component in components if len(component) > 1]


def test_no_module_imports_itself_by_way_of_others() -> None:
    found = {name: path for package in MAY_IMPORT for name, path in names_in(package).items()}
    graph = {name: imports_of(text(path), set(found)) for name, path in found.items()}
    assert circles(graph) == []


def test_a_circle_of_imports_is_seen() -> None:
    sources = {
        "a.x": "from a import y",
        "a.y": "def f():\n  from a.z import g",
        "a.z": "import a.x",
        "a.w": "import a.x",
    }
    assert circles({name: imports_of(source, set(sources)) for name, source in sources.items()}) == [
        {"a.x", "a.y", "a.z"}
    ]


GAME_WORDS = re.compile(r"patrol|drone|arena|pilot", re.IGNORECASE)
SHIPPED_FILES = re.compile(r"ros_ws/config/\w+\.yaml|--bag bags/\w+")
"""What examples of commands may name."""

GAMES = ("mabirds_core/games/patrol/", "mabirds_core/games/drones/")


def naming_games(source: str) -> list[str]:
    return [line for line in SHIPPED_FILES.sub("", source).splitlines() if GAME_WORDS.search(line)]


def test_nothing_but_its_package_names_a_game() -> None:
    others = (path for package in MAY_IMPORT for path in modules(package))
    lines = {str(path): naming_games(text(path)) for path in others if not any(own in str(path) for own in GAMES)}
    assert {path: found for path, found in lines.items() if found} == {}


def test_a_games_name_is_seen() -> None:
    assert naming_games('if kind == "drones":\n  pass\nmabirds run ros_ws/config/patrol.yaml') == [
        'if kind == "drones":'
    ]
