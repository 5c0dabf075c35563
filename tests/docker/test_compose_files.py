"""The compose files: by the schema of the compose specification, and by what the experiment takes."""

import json
import re
import shutil
import subprocess
import sys
from functools import cache
from itertools import pairwise
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest
import yaml

from mabirds_bringup.security.policy import Policy
from mabirds_core.experiment.file import Experiment, load_experiment

REPOSITORY = Path(__file__).resolve().parents[2]
DOCKER = REPOSITORY / "docker"
PLAIN, SECURE = DOCKER / "compose.yaml", DOCKER / "compose.secure.yaml"
DOCKER_CLIENT = shutil.which("docker")
KEYS = "/srv/mabirds/keystore/enclaves"


def read(file: Path) -> dict[str, Any]:
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    assert isinstance(content, dict)
    return content


@pytest.fixture(scope="module")
def plain(layout: ModuleType) -> dict[str, Any]:
    """What compose.yaml says without any variables."""
    return dict(layout._fill_in(read(PLAIN), {}))


@pytest.fixture(scope="module")
def secure(layout: ModuleType) -> dict[str, Any]:
    """What both files say together."""
    return dict(layout._fill_in(layout._merge(read(PLAIN), read(SECURE)), {}))


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    """The one that the services take unless told otherwise."""
    return load_experiment(REPOSITORY / "ros_ws" / "config" / "drones.yaml")


def volumes(content: dict[str, Any]) -> dict[str, dict[str, str]]:
    """By service, source by target."""
    return {
        name: {target: source for source, target, *_ in (text.split(":") for text in service["volumes"])}
        for name, service in content["services"].items()
    }


def conforms(*files: Path) -> tuple[int, str]:
    command = [Path(sys.executable).with_name("check-jsonschema"), "--builtin-schema", "vendor.compose-spec", *files]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout


def test_the_files_conform_to_the_compose_specification(secure: dict[str, Any], tmp_path: Path) -> None:
    merged = tmp_path / "merged.json"
    merged.write_text(json.dumps(secure), encoding="utf-8")
    code, words = conforms(PLAIN, SECURE, merged)
    assert code == 0, words


def test_the_schema_refuses_what_is_no_service(tmp_path: Path) -> None:
    """Else the test above would show nothing."""
    file = tmp_path / "compose.yaml"
    text = PLAIN.read_text(encoding="utf-8")
    file.write_text(text.replace("restart: on-failure", "restarts: on-failure"), encoding="utf-8")
    assert conforms(file)[0] == 1


def has_compose() -> bool:
    """Is there a Docker client that reads compose files? It takes no engine."""
    command = [DOCKER_CLIENT or "", "compose", "version"]
    return bool(DOCKER_CLIENT) and subprocess.run(command, capture_output=True, check=False).returncode == 0


@pytest.mark.skipif(not has_compose(), reason="no docker compose")
def test_docker_reads_the_files_as_the_layout_does(layout: ModuleType, tmp_path: Path) -> None:
    command = [DOCKER_CLIENT or "", "compose", "-f", PLAIN, "-f", SECURE, "config", "--format", "json"]
    services = json.loads(subprocess.run(command, capture_output=True, text=True, check=True).stdout)["services"]
    for service in layout.read_compose([PLAIN, SECURE], tmp_path, {}):
        assert services[service.name]["command"] == service.command
        assert services[service.name]["environment"] == service.environment


def test_every_learner_has_its_service_and_the_player_and_an_inspector_theirs(
    plain: dict[str, Any], experiment: Experiment
) -> None:
    services = plain["services"]
    assert set(services) == {*experiment.learners, "expert_player", "inspect", "record"}
    for name in experiment.learners:
        assert services[name]["command"][:4] == ["mabirds-learner", "--ros-args", "-r", f"__ns:=/{name}"]
        assert services[name]["healthcheck"]["test"][2:] == ["mabirds-healthy", name]
        assert services[name]["restart"] == "unless-stopped"
    assert services["expert_player"]["restart"] == "on-failure"
    for name in {*services} - {"record"}:
        assert services[name]["networks"] == ["learning"]
        assert services[name]["healthcheck"]["interval"]


def test_all_services_are_of_one_run_of_one_experiment(plain: dict[str, Any], experiment: Experiment) -> None:
    nodes = [plain["services"][name]["command"] for name in (*experiment.learners, "expert_player")]
    for parameter in ("experiment:=", "run:="):
        (value,) = {word for command in nodes for word in command if word.startswith(parameter)}
        assert len(value) > len(parameter)


def test_every_variable_has_a_default() -> None:
    for file in (PLAIN, SECURE):
        assert all(default for _, default in re.findall(r"\$\{(\w+)(:-[^}]*)?\}", file.read_text(encoding="utf-8")))


@cache
def told(*words: str) -> str:
    """The help of a program or verb."""
    command = [Path(sys.executable).with_name(words[0]), *words[1:], "--help"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def not_understood(command: list[str]) -> list[str]:
    """ROS parameters and options of a command that its program's help does not list."""
    parameters = [word.partition(":=")[0] for before, word in pairwise(command) if before == "-p"]
    if command[0] == "mabirds":
        words = told(*command[:2])
        return [
            word for word in command if word.startswith("--") and not re.search(rf"^\W*{word} ", words, re.MULTILINE)
        ]
    return [name for name in parameters if not re.search(rf"^  {name}  ", told(command[0]), re.MULTILINE)]


def test_every_command_is_understood(plain: dict[str, Any], layout: ModuleType) -> None:
    """By the help of the program that it starts."""
    services = plain["services"]
    checks = [one["healthcheck"]["test"] for name, one in services.items() if name != "record"]
    assert all(check[:2] == ["CMD", "mabirds-entrypoint"] for check in checks)
    for command in [*(one["command"] for one in services.values()), *(check[2:] for check in checks)]:
        if command[0] in layout.PROGRAMS:
            assert (command[0], len(command)) == ("mabirds-healthy", 2)
        else:
            assert not_understood(command) == []
    assert not_understood(["mabirds-learner", "-p", "experiment:=a", "-p", "speed:=1"]) == ["speed"]
    assert not_understood(["mabirds", "inspect", "--once", "--twice"]) == ["--twice"]


def test_volumes_are_declared_and_used(plain: dict[str, Any], secure: dict[str, Any]) -> None:
    for content in (plain, secure):
        used = {source for places in volumes(content).values() for source in places.values()}
        assert {source for source in used if not source.startswith(".")} == set(content["volumes"])
        assert all((DOCKER / source).is_dir() for source in used if source.startswith("."))


def test_demonstrations_stay_where_they_belong(plain: dict[str, Any], experiment: Experiment) -> None:
    """Checkpoints hold some, and bags all."""
    places = volumes(plain)
    for name in experiment.learners:
        assert places[name]["/srv/mabirds/checkpoints"] == name
        assert [other for other, targets in places.items() if name in targets.values()] == [name]
    assert {name for name, targets in places.items() if "/srv/mabirds/bags" in targets} == {"expert_player", "record"}
    assert "../bags:/srv/mabirds/bags:ro" in plain["services"]["expert_player"]["volumes"]


def test_every_container_has_the_keys_of_its_own_enclave_alone(secure: dict[str, Any], experiment: Experiment) -> None:
    enclaves = {process.enclave for process in Policy(experiment).processes()}
    places, services = volumes(secure), secure["services"]
    for name in {*services} - {"keystore", "record"}:
        environment = services[name]["environment"]
        enclave = environment["ROS_SECURITY_ENCLAVE_OVERRIDE"]
        assert enclave in enclaves
        assert enclave == ("/inspector" if name == "inspect" else f"/{name}")
        assert (environment["ROS_SECURITY_ENABLE"], environment["ROS_SECURITY_STRATEGY"]) == ("true", "Enforce")
        keys = {target: source for target, source in places[name].items() if source.startswith("keys_")}
        assert keys == {f"{KEYS}{enclave}": f"keys_{enclave[1:]}"}
        assert f"keys_{enclave[1:]}:{KEYS}{enclave}:ro" in services[name]["volumes"]
        assert places["keystore"][f"/srv/mabirds/keys{enclave}"] == f"keys_{enclave[1:]}"
        assert services[name]["depends_on"]["keystore"] == {"condition": "service_completed_successfully"}
        assert environment["OMP_NUM_THREADS"] == "1"
    assert [name for name, targets in places.items() if "authority" in targets.values()] == ["keystore"]
