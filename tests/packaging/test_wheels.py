"""The packages as PyPI has them: sdists, wheels built from these, and a fresh environment without torch and scipy."""

import importlib.util
import os
import shutil
import subprocess
import sys
import venv
import zipfile
from collections.abc import Callable, Iterator
from email.message import Message
from email.parser import Parser
from pathlib import Path

import pytest
import yaml

from mabirds_bringup.bench.study import PACKAGED

REPOSITORY = Path(__file__).resolve().parents[2]
SOURCES = ("src", "ros_ws", "packaging", "VERSION", "LICENSE")
PACKAGES = ("mabirds_core", "mabirds_msgs_py", "mabirds_expert_player", "mabirds_learner", "mabirds_bringup", "mabirds")
COMMANDS = {"mabirds", "mabirds-baseline", "mabirds-expert-player", "mabirds-learner"}
NOT_SOURCES = shutil.ignore_patterns("__pycache__", "*.egg-info", "build", "install", "log")

BUILD_SDIST = (
    "import os, sys; from setuptools import build_meta; os.chdir(sys.argv[1]); build_meta.build_sdist(sys.argv[2])"
)

Run = Callable[..., "subprocess.CompletedProcess[str]"]


def run(*command: str | Path, cwd: Path, timeout: float = 280) -> "subprocess.CompletedProcess[str]":
    """Run a command that knows nothing of this repository."""
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PYTHON")}
    environment = {**kept, "MPLBACKEND": "agg"}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=timeout, check=False
    )


def succeed(*command: str | Path, cwd: Path) -> str:
    done = run(*command, cwd=cwd)
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


def messages_wheel(place: Path) -> Path:
    """The compiled messages: those of ``make setup``, or built if they are not in its cache."""
    spec = importlib.util.spec_from_file_location("setup_workspace", REPOSITORY / "tools" / "setup_workspace.py")
    assert spec is not None
    assert spec.loader is not None
    workspace = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(workspace)
    cached = workspace.WHEEL_CACHE / workspace.digest(workspace.MESSAGE_SOURCES, *workspace.MACHINE)
    built: Path = next(cached.glob("*.whl"), None) or workspace.build_messages(place)
    return built


@pytest.fixture(scope="module")
def wheels(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """A wheel for each package, built from its sdist and nothing else."""
    place = tmp_path_factory.mktemp("built")
    for name in SOURCES:
        source, target = REPOSITORY / name, place / "sources" / name
        if source.is_dir():
            shutil.copytree(source, target, symlinks=True, ignore=NOT_SOURCES)
        else:
            shutil.copy(source, target)
    for package in PACKAGES:
        folder = place / "sources" / ("packaging" if package == "mabirds" else "src") / package
        succeed(sys.executable, "-c", BUILD_SDIST, folder, place / "sdists", cwd=place)
    shutil.rmtree(place / "sources")
    options = ("--no-deps", "--no-build-isolation", "--no-cache-dir", "--wheel-dir", place / "wheels")
    succeed(sys.executable, "-m", "pip", "wheel", *options, *(place / "sdists").iterdir(), cwd=place)
    return {wheel.name.partition("-")[0]: wheel for wheel in (place / "wheels").iterdir()}


@pytest.fixture(scope="module")
def programs(wheels: dict[str, Path], tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The directory of programs of an environment in which nothing happened but ``pip install mabirds``."""
    place = tmp_path_factory.mktemp("fresh")
    venv.create(place / "venv", symlinks=True)
    ours = {**wheels, "mabirds_msgs": messages_wheel(place)}
    pins = (REPOSITORY / "constraints.txt").read_text(encoding="utf-8")
    pins += "".join(f"{name} @ {wheel.as_uri()}\n" for name, wheel in ours.items())
    (place / "constraints.txt").write_text(pins, encoding="utf-8")
    pip = (sys.executable, "-m", "pip", "--python", place / "venv" / "bin" / "python")
    succeed(*pip, "install", "--no-compile", "--constraint", place / "constraints.txt", "mabirds", cwd=place)
    yield place / "venv" / "bin"
    shutil.rmtree(place)


@pytest.fixture(scope="module")
def experiments(programs: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The experiments that came with the wheel, and bags where these look for them, outside the repository."""
    place = tmp_path_factory.mktemp("outside")
    shutil.copytree(REPOSITORY / "bags", place / "bags")
    (config,) = programs.parent.glob("lib/python*/site-packages/mabirds_bringup/config")
    shutil.copytree(config, place / "my" / "experiments")
    unguided = (config / "drones_sac.yaml").read_text(encoding="utf-8")
    unguided = unguided.replace("kind: soft_actor_critic", "kind: soft_actor_critic, guide: none")
    (place / "my" / "experiments" / "networks.yaml").write_text(unguided, encoding="utf-8")
    return place / "my" / "experiments"


def names(wheel: Path) -> set[str]:
    with zipfile.ZipFile(wheel) as archive:
        return set(archive.namelist())


def metadata(wheel: Path) -> Message:
    with zipfile.ZipFile(wheel) as archive:
        (name,) = (name for name in archive.namelist() if name.endswith(".dist-info/METADATA"))
        return Parser().parsestr(archive.read(name).decode())


@pytest.mark.parametrize("package", PACKAGES)
def test_a_wheel_says_what_it_is(wheels: dict[str, Path], package: str) -> None:
    said = metadata(wheels[package])
    assert said["Version"] == (REPOSITORY / "VERSION").read_text(encoding="utf-8").strip()
    assert said["License-Expression"] == "Apache-2.0"
    assert said["Requires-Python"] == ">=3.11"
    assert {"Homepage", "Documentation"} <= {url.partition(",")[0] for url in said.get_all("Project-URL", [])}
    assert "Programming Language :: Python :: 3.13" in said.get_all("Classifier", [])
    assert str(said.get_payload()).startswith(f"# {package}\n")
    with zipfile.ZipFile(wheels[package]) as archive:
        (licence,) = (name for name in archive.namelist() if name.endswith("licenses/LICENSE"))
        assert archive.read(licence) == (REPOSITORY / "LICENSE").read_bytes()


@pytest.mark.parametrize("package", PACKAGES[:-1])
def test_a_wheel_has_all_modules_and_their_types(wheels: dict[str, Path], package: str) -> None:
    root = REPOSITORY / "src" / package
    modules = {str(path.relative_to(root)) for path in (root / package).rglob("*.py")}
    found = {name for name in names(wheels[package]) if name.startswith(f"{package}/") and "/launch/" not in name}
    assert {name for name in found if name.endswith(".py")} == modules
    assert f"{package}/py.typed" in found


def test_experiments_and_the_launch_file_come_twice_once_for_python_and_once_for_ros(wheels: dict[str, Path]) -> None:
    workspace = REPOSITORY / "ros_ws"
    files = [*workspace.glob("config/*.yaml"), *workspace.glob("launch/*.launch.py")]
    assert len(files) >= 7
    (share,) = {name.partition("/")[0] for name in names(wheels["mabirds_bringup"]) if ".data/data/share/" in name}
    with zipfile.ZipFile(wheels["mabirds_bringup"]) as archive:
        for file in files:
            place = file.relative_to(workspace)
            for folder in ("mabirds_bringup", f"{share}/data/share/mabirds_bringup"):
                assert archive.read(f"{folder}/{place}") == file.read_bytes()


def test_studies_come_with_the_experiments_that_they_name(wheels: dict[str, Path]) -> None:
    there = names(wheels["mabirds_bringup"])
    studies = sorted(PACKAGED.glob("*.yaml"))
    assert {f"mabirds_bringup/studies/{study.name}" for study in studies} <= there
    files = {
        file for study in studies for file in yaml.safe_load(study.read_text(encoding="utf-8"))["experiments"].values()
    }
    assert {f"mabirds_bringup/{file.removeprefix('../')}" for file in files} <= there


def test_the_profiles_of_fast_dds_come_too(wheels: dict[str, Path]) -> None:
    assert {f"mabirds_msgs_py/fastdds_{kind}profile.xml" for kind in ("", "loopback_", "one_host_")} <= names(
        wheels["mabirds_msgs_py"]
    )


def test_only_commands_of_this_project_are_on_the_path(programs: Path) -> None:
    found = {path.name for path in programs.iterdir()}
    assert {name for name in found if name.startswith("mabirds")} == COMMANDS
    assert not found & {"learner", "baseline", "expert_player"}


def test_heavy_libraries_are_not_brought(programs: Path, tmp_path: Path) -> None:
    program = (
        "from importlib.util import find_spec\nprint([n for n in ('torch', 'scipy', 'cryptography') if find_spec(n)])"
    )
    assert succeed(programs / "python", "-c", program, cwd=tmp_path) == "[]\n"


def test_an_experiment_outside_the_repository_is_learned(programs: Path, experiments: Path, tmp_path: Path) -> None:
    succeed(programs / "mabirds", "simulate", experiments / "patrol.yaml", "--out", tmp_path / "runs", cwd=tmp_path)
    made = {path.name for path in (tmp_path / "runs" / "latest").iterdir()}
    assert {"manifest.json", "report.html"} <= made
    assert any(name.endswith(".png") for name in made)


@pytest.mark.parametrize(
    ("command", "experiment", "remedy"),
    [
        (["simulate"], "drones.yaml", "pip install 'mabirds_core[drones]'"),
        (["simulate"], "drones_sac.yaml", "pip install 'mabirds_core[drones]'"),
        (["simulate"], "networks.yaml", "pip install 'mabirds_core[sac]'"),
        (["record", "--bag", "bag"], "drones.yaml", "pip install 'mabirds_core[drones]'"),
        (["security", "create", "--keystore", "keystore"], "patrol.yaml", "pip install 'mabirds_bringup[security]'"),
    ],
)
def test_where_a_library_is_missing_the_remedy_is_named(
    programs: Path, experiments: Path, tmp_path: Path, command: list[str], experiment: str, remedy: str
) -> None:
    done = run(programs / "mabirds", *command, experiments / experiment, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert remedy in done.stderr
    assert "Traceback" not in done.stderr


def test_a_learner_names_the_remedy_as_well(programs: Path, experiments: Path, tmp_path: Path) -> None:
    arguments = ("--ros-args", "-r", "__ns:=/learner_1", "-p", f"experiment:={experiments / 'drones.yaml'}")
    done = run(programs / "mabirds-learner", *arguments, cwd=tmp_path)
    assert done.returncode == 2, done.stderr
    assert "pip install 'mabirds_core[drones]'" in done.stderr


def test_a_users_script_is_checked_against_the_types(programs: Path, tmp_path: Path) -> None:
    script = """
from pathlib import Path
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.topics import bag_topic
from mabirds_bringup.run.run_directory import create
iterations: {wanted} = load_experiment(Path("mine.yaml")).iterations
place: Path = create(Path("runs"), bag_topic("learner_1"))
"""
    (tmp_path / "right.py").write_text(script.format(wanted="int"), encoding="utf-8")
    (tmp_path / "wrong.py").write_text(script.format(wanted="str"), encoding="utf-8")
    mypy = (sys.executable, "-m", "mypy", "--strict", "--python-executable", programs / "python")
    assert "no issues found" in succeed(*mypy, "right.py", cwd=tmp_path)
    wrong = run(*mypy, "wrong.py", cwd=tmp_path).stdout
    assert 'expression has type "int", variable has type "str"' in wrong
