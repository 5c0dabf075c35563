"""What the packages say of themselves: one version, the libraries that they import, the commands that they bring."""

import ast
import re
import subprocess
import sys
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGES = ("mabirds_core", "mabirds_msgs_py", "mabirds_expert_player", "mabirds_learner", "mabirds_bringup")
MESSAGES = REPOSITORY / "ros_ws" / "src" / "mabirds_msgs"

FROM_WHEELS = {
    "ament_index_python": "ros-jazzy-rclpy",
    "builtin_interfaces": "ros-jazzy-rclpy",
    "rcl_interfaces": "ros-jazzy-rclpy",
    "rclpy": "ros-jazzy-rclpy",
    "diagnostic_msgs": "ros-jazzy-common-interfaces",
    "geometry_msgs": "ros-jazzy-common-interfaces",
    "nav_msgs": "ros-jazzy-common-interfaces",
    "std_msgs": "ros-jazzy-common-interfaces",
    "visualization_msgs": "ros-jazzy-common-interfaces",
    "PIL": "pillow",
    "pydantic_core": "pydantic",
    "rosgraph_msgs": "ros-jazzy-rclpy",
    "yaml": "pyyaml",
}
"""What brings a module, where that is named otherwise."""

NOT_IMPORTED = {"mabirds_msgs_py": {"ros-jazzy-rmw-fastrtps-cpp"}}
"""Declared all the same: rclpy loads it."""


def metadata(package: str) -> dict[str, Any]:
    text = (REPOSITORY / "src" / package / "pyproject.toml").read_text(encoding="utf-8")
    project: dict[str, Any] = tomllib.loads(text)["project"]
    return project


def plain(requirement: str) -> str:
    """The name alone, as indexes spell it."""
    (name,) = re.findall(r"^[\w.-]+", requirement)
    return re.sub(r"[-_.]+", "-", name).lower()


def imported(package: str) -> Iterator[str]:
    """Root modules that a package imports, inside functions too, less itself and Python's own."""
    for path in (REPOSITORY / "src" / package / package).rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module and node.level == 0:
                names = [node.module]
            roots = {name.partition(".")[0] for name in names}
            yield from roots - sys.stdlib_module_names - {package, "_typeshed"}


def declared(package: str) -> tuple[set[str], set[str]]:
    """What a package requires, and what its extras bring besides."""
    project = metadata(package)
    extras = {name: lines for name, lines in project["optional-dependencies"].items() if name != "test"}
    return set(map(plain, project["dependencies"])), {plain(line) for lines in extras.values() for line in lines}


@pytest.mark.parametrize("package", PACKAGES)
def test_a_package_declares_what_it_imports_and_nothing_else(package: str) -> None:
    needed = {plain(FROM_WHEELS.get(root, root)) for root in imported(package)}
    required, optional = declared(package)
    assert len(needed) > 2
    assert needed - required - optional == set()
    assert required - needed == NOT_IMPORTED.get(package, set())


def test_what_make_setup_installs_has_all_that_is_declared() -> None:
    """For it installs the packages without looking at their requirements."""
    lines = (REPOSITORY / "requirements.txt").read_text(encoding="utf-8").partition("# Development")[0].splitlines()
    installed = {plain(line) for line in lines if line and not line.startswith("#")}
    everything = set[str]().union(*(names for package in PACKAGES for names in declared(package)))
    assert {name for name in everything - installed if not name.startswith("mabirds")} == set()


def test_heavy_libraries_are_extras() -> None:
    heavy = {"scipy", "torch", "cryptography"}
    assert not any(declared(package)[0] & heavy for package in PACKAGES)
    assert metadata("mabirds_core")["optional-dependencies"].keys() >= {"drones", "sac", "report"}
    assert metadata("mabirds_bringup")["optional-dependencies"].keys() >= {"drones", "sac", "security"}


def test_no_program_loads_the_libraries_of_extras_before_it_needs_them() -> None:
    programs = ("mabirds_bringup.cli", "mabirds_learner.baseline_node", "mabirds_expert_player.player_node")
    hide = "import sys\nfor name in ('scipy', 'torch', 'cryptography'): sys.modules[name] = None\n"
    done = subprocess.run(
        [sys.executable, "-c", hide + "".join(f"import {program}\n" for program in programs)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr


def test_the_commands_have_the_name_of_the_project() -> None:
    commands = [name for package in PACKAGES for name in metadata(package).get("scripts", {})]
    assert sorted(commands) == ["mabirds", "mabirds-baseline", "mabirds-expert-player", "mabirds-learner"]


def test_there_is_one_version() -> None:
    """VERSION has it. Packages see it by a link; package.xml, which ROS reads, needs a copy."""
    version = (REPOSITORY / "VERSION").read_text(encoding="utf-8").strip()
    assert re.fullmatch(r"\d+\.\d+\.\d+", version)
    folders = [REPOSITORY / "src" / package for package in PACKAGES]
    for folder in (*folders, REPOSITORY / "packaging" / "mabirds"):
        assert (folder / "VERSION").resolve() == REPOSITORY / "VERSION"
    files = [folder / "package.xml" for folder in (*folders, MESSAGES)]
    written = {file: re.findall("<version>(.*)</version>", file.read_text(encoding="utf-8")) for file in files}
    assert written == {file: [version] for file in files}


def test_no_other_file_of_a_package_has_a_version() -> None:
    roots = (REPOSITORY / "src", REPOSITORY / "packaging", MESSAGES)
    files = [file for root in roots for name in ("*.py", "*.toml", "*.cfg") for file in root.rglob(name)]
    written = re.compile(r"""^_*version_*\s*=\s*["']""", re.MULTILINE)
    assert len(files) > 100
    assert [file for file in files if written.search(file.read_text(encoding="utf-8"))] == []


@pytest.mark.parametrize("package", PACKAGES)
def test_colcon_can_read_which_python_is_required(package: str) -> None:
    """It takes literals alone, and setuptools makes an object of requires-python in pyproject.toml."""
    assert "requires-python" not in metadata(package)
    setup = (REPOSITORY / "src" / package / "setup.py").read_text(encoding="utf-8")
    assert 'python_requires=">=3.11"' in setup
