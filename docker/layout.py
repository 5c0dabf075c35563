#!/usr/bin/env python3
"""Start the services of compose.yaml without Docker, each on a host of its own: a network namespace.

usage: .venv/bin/python docker/layout.py [--compose FILE ...] [--out runs] [--timeout 600] [--json]

Commands, environment, volumes and healthchecks are those of compose.yaml, at the paths that the containers have; the
same variables choose the experiment (docker/README.md). It ends when every learner has learned everything and every
healthcheck has passed, stops what it started, and prints a digest of each learner's theta and omega. It takes root.

Exit codes: 0 all of this; 2 bad input, or no namespaces here; 3 a service ended early, or was not healthy or done in
time.
"""

import hashlib
import json
import os
import re
import shlex
import subprocess
import sys
import time
from argparse import ArgumentParser, RawDescriptionHelpFormatter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial, reduce
from pathlib import Path
from typing import Any

import yaml

from mabirds_bringup.run import processes, run_directory
from mabirds_bringup.run.processes import NodeProcess
from mabirds_core.errors import MabirdsError
from mabirds_core.experiment.file import load_experiment
from mabirds_learner.checkpoint import newest_of_anybody
from mabirds_msgs_py.supervised import SUPERVISOR

DOCKER = Path(__file__).resolve().parent
sys.path.insert(0, str(DOCKER.parent / "tests" / "network"))  # the tests' own virtual networks
from namespaces import VirtualLan, virtual_lan  # noqa: E402

PROGRAMS = {
    "mabirds-entrypoint": "entrypoint.sh",
    "mabirds-healthy": "healthy.py",
    "mabirds-make-keystore": "make_keystore.sh",
    "mabirds-hear-learner": "hear_learner.sh",
}
"""What the Dockerfile puts into /usr/local/bin, and from where."""

HOME = Path("/srv/mabirds")
"""The containers' working directory; all volumes are mounted below it."""

LEARNER, CHECKPOINTS = "mabirds-learner", str(HOME / "checkpoints")
VARIABLE = re.compile(r"\$(?:\$|\{(\w+)(?::-([^}]*))?\})")
REPLACED = {"command", "test"}
"""Lists of which the last file's counts; others are joined."""

TICK = 0.2


class LayoutError(MabirdsError):
    """The services cannot be started as compose.yaml says, or one does not do its work."""


@dataclass(frozen=True)
class Service:
    """What compose.yaml says of one container.

    ``volumes``: source, target and whether it is read-only. ``after``: services that have to be done before.
    """

    name: str
    command: Sequence[str]
    environment: Mapping[str, str]
    volumes: Sequence[tuple[Path, str, bool]]
    healthcheck: Sequence[str]
    after: Sequence[str]

    def inside(self, bin_directory: Path, command: Sequence[str]) -> list[str]:
        """The command as the container runs it: its files at their places, its environment and nothing else."""
        base = {"PATH": f"{bin_directory}:{Path(sys.executable).parent}:{os.defpath}", "HOME": str(HOME)}
        environment = {**base, SUPERVISOR: str(os.getpid()), **self.environment}
        assignments = [f"{name}={value}" for name, value in environment.items()]
        steps = [f"mount -t tmpfs mabirds {HOME.parent}", *map(_mount, self.volumes), f"cd {HOME}", 'exec "$@"']
        return ["sh", "-euc", "\n".join(steps), "sh", "env", "-i", *assignments, *command]


def _mount(volume: tuple[Path, str, bool]) -> str:
    source, target, read_only = volume
    options = "bind,ro" if read_only else "bind"
    return f"mkdir -p {target}; mount -o {options} {shlex.quote(str(source))} {target}"


def read_compose(files: Sequence[Path], volumes: Path, variables: Mapping[str, str] = os.environ) -> list[Service]:
    """The services that ``docker compose up`` starts, each after those that it waits for.

    Later files add to earlier ones. Named volumes become directories of ``volumes``.
    """
    contents = [yaml.safe_load(file.read_text(encoding="utf-8")) for file in files]
    merged = _fill_in(reduce(_merge, contents), variables)["services"]
    chosen = {name: content for name, content in merged.items() if "profiles" not in content}
    services = [_service(name, content, files[0].parent, volumes) for name, content in chosen.items()]
    return sorted(services, key=lambda service: len(service.after))  # none waits for one that waits


def _merge(before: dict[str, Any], after: dict[str, Any]) -> dict[str, Any]:
    """What two files say together."""
    merged = dict(before)
    for name, value in after.items():
        if isinstance(value, dict):
            merged[name] = _merge(merged.get(name) or {}, value)
        elif isinstance(value, list) and name not in REPLACED:
            merged[name] = [*merged.get(name, []), *value]
        else:
            merged[name] = value
    return merged


def _fill_in(content: Any, variables: Mapping[str, str]) -> Any:
    """Replace ${NAME} and ${NAME:-default} everywhere."""
    if isinstance(content, dict):
        return {name: _fill_in(value, variables) for name, value in content.items()}
    if isinstance(content, list):
        return [_fill_in(value, variables) for value in content]
    if isinstance(content, str):
        return VARIABLE.sub(lambda match: (variables.get(match[1]) or match[2] or "") if match[1] else "$", content)
    return content


def _service(name: str, content: dict[str, Any], directory: Path, volumes: Path) -> Service:
    environment = {key: str(value) for key, value in content.get("environment", {}).items()}
    mounts = [_volume(text, directory, volumes) for text in content.get("volumes", [])]
    kind, *check = content.get("healthcheck", {}).get("test", ["CMD"])
    if kind != "CMD":
        raise LayoutError(f"{name}: healthcheck {kind}: expected CMD and a list of words")
    return Service(name, content["command"], environment, mounts, check, list(content.get("depends_on", {})))


def _volume(text: str, directory: Path, volumes: Path) -> tuple[Path, str, bool]:
    source, target, *mode = text.split(":")
    is_path = source.startswith((".", "/"))
    place = (directory / source).resolve() if is_path else volumes / source
    if not is_path:
        place.mkdir(parents=True, exist_ok=True)
    for path in (place, Path(sys.prefix), DOCKER):
        if path.is_relative_to(HOME.parent):
            raise LayoutError(f"{path}: {HOME.parent} is where the containers' files are shown; move it elsewhere")
    if not place.is_dir():
        raise LayoutError(f"{place}: no such directory; it is to be mounted at {target}")
    return place, target, mode == ["ro"]


def _programs(directory: Path) -> Path:
    """A directory with the image's programs."""
    directory.mkdir(exist_ok=True)
    for name, source in PROGRAMS.items():
        (directory / name).symlink_to(DOCKER / source)
    return directory


@dataclass
class Layout:
    """Services as processes on hosts of their own."""

    services: Sequence[Service]
    directory: Path
    lan: VirtualLan
    running: dict[str, NodeProcess]

    def start(self, deadline: float) -> None:
        """Start all services, each once those are done that it waits for."""
        self._bin = _programs(self.directory / "bin")
        for service in self.services:
            for name in service.after:
                self.wait(partial(self.is_done, name), f"{name} done", deadline)
            command = self.lan.inside(service.name, service.inside(self._bin, ["mabirds-entrypoint", *service.command]))
            self.running[service.name] = processes.start(service.name, command, self.directory / "logs")

    def is_done(self, name: str) -> bool:
        """Has a service ended well?"""
        return self.running[name].exit_code == 0

    def wait(self, condition: Callable[[], bool], what: str, deadline: float) -> None:
        """Wait until the condition holds; raises LayoutError where a service ends badly or time is up."""
        while True:
            for name, process in self.running.items():
                if process.exit_code:
                    said = processes.last_lines(process.log)
                    raise LayoutError(f"{name} ended with code {process.exit_code}: {said}")
            if condition():
                return
            if time.monotonic() > deadline:
                raise LayoutError(f"not in time: {what}; see {self.directory / 'logs'}")
            time.sleep(TICK)

    def is_healthy(self, service: Service) -> bool:
        """Does the service's healthcheck pass, or has the service done its work?"""
        if self.is_done(service.name):
            return True
        command = self.lan.inside(service.name, service.inside(self._bin, service.healthcheck))
        with (self.directory / "logs" / f"{service.name}.health").open("ab") as log:
            return subprocess.run(command, stdout=log, stderr=log, check=False).returncode == 0


def last_checkpoints(services: Sequence[Service]) -> dict[str, tuple[Path, int]]:
    """By learner, the directory of its checkpoints, and the iteration of the one written once everything is learned."""
    checkpoints = {}
    for service in filter(_lasts, services):
        experiment = load_experiment(_experiment(service))
        last = 1 + experiment.iterations + experiment.closing_rounds
        place = next(source for source, target, _ in service.volumes if target == CHECKPOINTS)
        checkpoints[service.name] = place, last
    return checkpoints


def _lasts(service: Service) -> bool:
    """Learners stay when everything is learned; the player does not."""
    return service.command[0] == LEARNER


def _experiment(service: Service) -> Path:
    """The experiment file that a service names, where it is on this machine."""
    named = next(word for word in service.command if word.startswith("experiment:="))
    path = Path(named.partition(":=")[2])
    for source, target, _ in service.volumes:
        if path.is_relative_to(target):
            return source / path.relative_to(target)
    raise LayoutError(f"{service.name}: {path} is on none of its volumes")


def has_reached(directory: Path, iteration: int) -> bool:
    """Is the checkpoint of an iteration written?"""
    found = newest_of_anybody(directory)
    return found is not None and found[0] >= iteration


def digests(directory: Path) -> dict[str, str]:
    """SHA-256 of the bytes of theta and omega of the newest checkpoint."""
    found = newest_of_anybody(directory)
    if found is None:
        raise LayoutError(f"{directory}: no checkpoint")
    _, arrays = found
    return {name: hashlib.sha256(arrays[name].tobytes()).hexdigest() for name in ("theta", "omega")}


def run(compose: Sequence[Path], directory: Path, timeout: float) -> dict[str, dict[str, str]]:
    """Run the layout to its end; digests by learner."""
    services = read_compose(compose, directory / "volumes")
    checkpoints, deadline = last_checkpoints(services), time.monotonic() + timeout
    with virtual_lan([service.name for service in services]) as lan:
        layout = Layout(services, directory, lan, {})
        try:
            layout.start(deadline)
            for service in sorted((service for service in services if service.healthcheck), key=_lasts):
                layout.wait(partial(layout.is_healthy, service), f"{service.name} healthy", deadline)
            for name, (place, last) in checkpoints.items():
                layout.wait(partial(has_reached, place, last), f"{name} has learned everything", deadline)
        finally:
            processes.stop(list(layout.running.values()))
    return {name: digests(place) for name, (place, _) in checkpoints.items()}


def main() -> int:
    """Entry point."""
    parser = ArgumentParser(description=__doc__, formatter_class=RawDescriptionHelpFormatter)
    parser.add_argument("--compose", type=Path, action="append", help="files to read (compose.yaml beside this one)")
    parser.add_argument("--out", type=Path, default=Path("runs"), help="where a run directory is made")
    parser.add_argument("--timeout", type=float, default=600.0, help="seconds to the end")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    arguments = parser.parse_args()
    directory = run_directory.create(arguments.out.absolute(), "layout")
    try:
        checkpoints = run(arguments.compose or [DOCKER / "compose.yaml"], directory, arguments.timeout)
    except LayoutError as error:
        print(f"error: {error}", file=sys.stderr)
        return 3
    except MabirdsError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2
    if arguments.json:
        print(json.dumps({"directory": str(directory), "learners": checkpoints}, indent=2))
    else:
        print(
            *(
                f"{name} theta {checkpoint['theta']} omega {checkpoint['omega']}"
                for name, checkpoint in checkpoints.items()
            ),
            sep="\n",
        )
    return 0


if __name__ == "__main__":
    sys.exit(main())
