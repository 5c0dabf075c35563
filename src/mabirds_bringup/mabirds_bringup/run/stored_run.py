"""A run directory read back: what ran, how it was started, and what is known of it."""

import fcntl
import json
import os
import secrets
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import yaml

from mabirds_bringup.run import run_directory
from mabirds_bringup.watch.admission import initial_parameters
from mabirds_bringup.watch.watched_history import DIRECTORY, WatchedHistory
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment, load_experiment

EXPERIMENT = "experiment.yaml"
"""The experiment as it was when the run began, with the place of its bag: a run goes on with this one."""

LOCK = "lock"

NETWORK, IN_PROCESS = "network", "in process"


@dataclass(frozen=True)
class RunPlan:
    """How a network was started, in its manifest.

    ``run``: its name. ``player``: parameters of the player. ``method``: a central method in the learners' place.
    ``restarts``: how often a node may be started again. ``only``: the nodes of this host; none: all.
    """

    run: str
    player: Mapping[str, Any] = field(default_factory=dict)
    method: str | None = None
    restarts: int = 3
    only: Sequence[str] = ()

    @property
    def bags(self) -> list[Path]:
        """That are played in the place of the experiment's."""
        return [Path(bag) for bag in self.player.get("bags", [])]


@dataclass(frozen=True)
class StoredRun:
    """A run directory with its experiment and manifest."""

    directory: Path
    experiment: Experiment
    manifest: Mapping[str, Any]

    @property
    def file(self) -> Path:
        """The experiment file of the run."""
        return self.directory / EXPERIMENT

    @property
    def checkpoints(self) -> Path:
        """Where learners of this host write theirs."""
        return self.directory / "checkpoints"

    @cached_property
    def plan(self) -> RunPlan:
        """How the run was started; one in process has no name."""
        return RunPlan(**self.manifest.get(NETWORK, {"run": ""}))

    @property
    def digest(self) -> str:
        """Of the run."""
        return self.experiment.run_digest(self.plan.run)

    @property
    def bag_digest(self) -> str | None:
        """Of the demonstrations; None on a host that had none."""
        return self.manifest["digests"]["bag"]

    @property
    def names(self) -> tuple[str, ...]:
        """Who learns."""
        method = self.plan.method or self.manifest.get("method")
        return (method,) if method else self.experiment.learners

    @property
    def last(self) -> int:
        """The iteration after which nothing is left to do."""
        closing = 0 if set(self.names) - set(self.experiment.learners) else self.experiment.closing_rounds
        return self.experiment.iterations + closing + 1

    def open_history(self) -> WatchedHistory:
        """What is known of all iterations."""
        initial = {name: initial_parameters(self.experiment, name) for name in self.names}
        return WatchedHistory(self.directory / DIRECTORY, initial, self.experiment.learners, self.digest)

    def summary(self) -> Mapping[str, Any]:
        """What summary.json holds; nothing where there is none."""
        file = self.directory / "summary.json"
        return _read_json(file) if file.exists() else {}


def begin(
    out: Path, experiment: Experiment, file: Path, *, bag_digest: str | None, plan: RunPlan | None, method: str | None
) -> StoredRun:
    """Make a run directory. ``plan``: of a network; None: of a run in process, with ``method`` or without."""
    directory = run_directory.create(out, experiment.name)
    if plan and not plan.run and not plan.only:
        plan = replace(plan, run=f"{directory.name}-{secrets.token_hex(4)}")  # a name that no other run has
    write_experiment(directory / EXPERIMENT, experiment)
    more: dict[str, Any] = {"method": method} if plan is None else {NETWORK: asdict(plan)}
    mode = IN_PROCESS if plan is None else NETWORK
    run_directory.write_manifest(directory, experiment, file, mode, bag_digest, more)
    return load_run(directory)


def write_experiment(file: Path, experiment: Experiment) -> None:
    """Write the settings with all defaults, and the place of the bag."""
    content = experiment.model_dump(mode="json")
    file.write_text(yaml.safe_dump(content, sort_keys=False), encoding="utf-8")


def load_run(directory: Path) -> StoredRun:
    """Read a run directory.

    Raises ExperimentError where it is none, or where its experiment is not the one that its manifest names.
    """
    manifest = _read_json(directory / "manifest.json")
    run = StoredRun(directory, load_experiment(directory / EXPERIMENT), manifest)
    try:
        for name, found in (("experiment", run.experiment.digest), ("schedule", run.experiment.edge_schedule.digest)):
            if manifest["digests"][name] != found:
                raise ExperimentError(
                    f"{run.file}: digest of the {name} {found}, expected {manifest['digests'][name]} as in the"
                    " manifest: one of the files was changed; restore it, or start another run"
                )
        _ = run.plan, run.bag_digest
    except (KeyError, TypeError) as error:
        raise ExperimentError(f"{directory}: its manifest is of another version ({error}); start another run") from None
    return run


def _read_json(file: Path) -> Mapping[str, Any]:
    try:
        content = json.loads(file.read_text(encoding="utf-8"))
    except OSError as error:
        raise ExperimentError(
            f"{file}: cannot be read ({error.strerror}); give a run directory, such as runs/latest"
        ) from None
    except ValueError as error:
        raise ExperimentError(f"{file}: is no JSON ({error}); give a whole run directory") from None
    if not isinstance(content, dict):
        raise ExperimentError(f"{file}: expected an object; give a whole run directory")
    return content


def find_run(out: Path, experiment: Experiment, plan: RunPlan) -> StoredRun | None:
    """The newest run below ``out`` of the plan's name, experiment and nodes, which the same command goes on with."""
    for manifest in sorted(out.glob("*/manifest.json"), reverse=True):
        if manifest.parent.is_symlink() or _read_json(manifest).get(NETWORK, {}).get("run") != plan.run:
            continue
        run = load_run(manifest.parent)
        if sorted(run.plan.only) == sorted(plan.only):
            _require_same(run, experiment, plan)
            return run
    return None


def _require_same(run: StoredRun, experiment: Experiment, plan: RunPlan) -> None:
    before, now = run.experiment, experiment
    same = (before.digest, before.edge_schedule.digest) == (now.digest, now.edge_schedule.digest)
    if not same or run.plan.method != plan.method:
        raise ExperimentError(
            f"--run {plan.run}: {run.directory} is a run of this name with another experiment; give this one another"
            " name, or take the same experiment file"
        )


@contextmanager
def locked(directory: Path) -> Iterator[None]:
    """Keep other supervisors away from a run directory."""
    descriptor = os.open(directory / LOCK, os.O_WRONLY | os.O_CREAT, 0o644)
    try:
        fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        yield
    except BlockingIOError:
        raise ExperimentError(
            f"{directory}: another `mabirds run` is at work on it; wait until it ends, or end it"
        ) from None
    finally:
        os.close(descriptor)
