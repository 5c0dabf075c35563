"""The run directory: everything needed to understand a run later, in one place."""

import csv
import json
import os
import platform
import shlex
import subprocess
import sys
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import asdict, fields
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from itertools import chain, count
from pathlib import Path
from typing import Any, Self, TextIO

from mabirds_bringup.evaluate.evaluation import Evaluation
from mabirds_bringup.evaluate.policies import LearnerMetrics
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment

CONTENTS = {
    "manifest.json": "run name, settings, digests, seeds, versions, commit, command",
    "experiment.yaml": "the experiment as it was at the start, with the place of its bag; a run goes on with this one",
    "summary.json": "whether the run is complete, the last iteration and the digest of the final parameters of each"
    " learner, digest of the bag; per learner CVR, SR, FPR, FNR and learned constraints; consensus distances; the"
    " delivered graph, audited; wall time; first without verdicts of other planners, with how much is"
    " to_be_judged",
    "metrics.csv": "rates and consensus distances per learner and iteration",
    "report.html": "what was learned in words, rates, constraints, settings; one file, with its figures inside",
    "report.md": "the same as Markdown",
    "map.png": "what each learner takes for forbidden, and how it would act",
    "curves.png": "rates and consensus distances against demonstrations",
    "schedule.png": "who was to hear whom, slot by slot",
    "delivered.png": "who really heard whom, iteration by iteration; of a network's run",
    "parameters": "theta and omega of every learner and iteration, and whose it mixed",
    "checkpoints": "of every learner; they hold demonstrations",
    "bag": "parameters, status and schedule of every learner; no demonstrations, which stay where they belong",
    "logs": "one log per process",
}
"""Files and folders of a run directory and what they hold; ``parameters`` and what follows are a network's."""

METRICS = "metrics.csv"

COLUMNS = [field.name for field in fields(LearnerMetrics)]

PACKAGES = ("mabirds-core", "mabirds-msgs", "numpy", "ros-rclpy", "ros-fastrtps", "mcap")


def create(root: Path, name: str) -> Path:
    """Make ``root/<time>-<name>`` with a place for logs; ``root/latest`` points to it."""
    root.mkdir(parents=True, exist_ok=True)
    stem = f"{datetime.now(UTC):%Y%m%dT%H%M%S}-{name}"
    for directory in (root / name for name in chain([stem], (f"{stem}-{n}" for n in count(2)))):
        with suppress(FileExistsError):
            directory.mkdir()
            break
    (directory / "logs").mkdir()
    make_latest(directory)
    return directory


def make_latest(directory: Path) -> None:
    """Make or move, in one step, the link ``latest`` beside a run directory."""
    link, target = directory.parent / "latest", directory.name
    temporary = link.with_name(f".latest-{os.getpid()}")
    temporary.unlink(missing_ok=True)
    temporary.symlink_to(target)
    temporary.replace(link)


def command_line() -> str:
    """The command as it was typed, be it ``mabirds`` or ``python -m mabirds_bringup``."""
    name = Path(sys.argv[0]).name
    return shlex.join(["mabirds" if name == "__main__.py" else name, *sys.argv[1:]])


def write_manifest(
    directory: Path, experiment: Experiment, file: Path, mode: str, bag_digest: str | None, more: Mapping[str, Any]
) -> None:
    """manifest.json: what ran, with which versions, seeds and digests. ``more``: how a network was started."""
    write_json(
        directory / "manifest.json",
        {
            "experiment": experiment.name,
            "mode": mode,
            "file": file.name,
            "settings": experiment.model_dump(mode="json", exclude={"demonstrations": {"bag"}}),
            "bag": experiment.demonstrations.bag.name,
            "digests": {
                "game": build_game(experiment).digest,
                "experiment": experiment.digest,
                "schedule": experiment.edge_schedule.digest,
                "bag": bag_digest,
            },
            **more,
            "seeds": {"learners": experiment.seed, "demonstrations": experiment.demonstrations.seed},
            "commit": _commit(file.resolve().parent),
            "versions": {"python": platform.python_version(), **{name: _version(name) for name in PACKAGES}},
            "machine": {"system": platform.platform(), "cores": os.cpu_count()},
            "command": command_line(),
            "started": datetime.now(UTC).isoformat(timespec="seconds"),
        },
    )


def _commit(directory: Path) -> str | None:
    """The commit of the experiment file's repository, or None outside of one."""
    command = ["git", "-C", str(directory), "describe", "--always", "--dirty", "--abbrev=40"]
    try:
        result = subprocess.run(command, capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return None
    return result.stdout.strip() or None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def write_metrics(directory: Path, evaluation: Evaluation) -> None:
    """metrics.csv: one row per learner and iteration, with the consensus distances of that iteration."""
    with (directory / METRICS).open("w", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, [*COLUMNS, "consensus_theta", "consensus_omega"])
        writer.writeheader()
        for row in evaluation.rows:
            distances = {
                f"consensus_{name}": values[row.iteration - 1]
                for name, values in (("theta", evaluation.consensus_theta), ("omega", evaluation.consensus_omega))
                if row.iteration <= len(values)
            }
            writer.writerow({**asdict(row), **distances})


class JudgedRows:
    """Rows of metrics.csv as they are judged, so that they are kept whatever ends the judging; a context manager.

    Nothing is written before the first row that is new.
    """

    def __init__(self, directory: Path) -> None:
        self._directory = directory
        self._stream: TextIO | None = None
        self.known = {(row.learner, row.iteration): row for row in read_judged(directory)}

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        if self._stream:
            self._stream.close()

    def add(self, row: LearnerMetrics) -> None:
        """Write a row down, unless it is known."""
        if (row.learner, row.iteration) in self.known:
            return
        if self._stream is None:
            self._stream = self._begun()
        self.known[row.learner, row.iteration] = row
        csv.DictWriter(self._stream, COLUMNS).writerow(asdict(row))
        self._stream.flush()

    def _begun(self) -> TextIO:
        """The file with what was known, to be added to."""
        unfinished = self._directory / f".{METRICS}.unfinished"
        stream = unfinished.open("w", newline="", encoding="utf-8")
        writer = csv.DictWriter(stream, COLUMNS)
        writer.writeheader()
        writer.writerows(map(asdict, self.known.values()))
        stream.flush()
        unfinished.replace(self._directory / METRICS)
        return stream


def read_judged(directory: Path) -> list[LearnerMetrics]:
    """What metrics.csv says was judged, up to where it was cut short; nothing where there is none."""
    file, rows = directory / METRICS, list[LearnerMetrics]()
    if not file.exists():
        return rows
    with file.open(newline="", encoding="utf-8") as stream, suppress(KeyError, TypeError, ValueError):
        rows.extend(map(_judged, csv.DictReader(line for line in stream if line.endswith("\n"))))
    return rows


def _judged(row: Mapping[str, str]) -> LearnerMetrics:
    names = ("violation_rate", "success_rate", "held_out_log_likelihood", "certificate")
    numbers = [float(row[name]) if row[name] else None for name in names]
    return LearnerMetrics(row["learner"], int(row["iteration"]), *numbers)


def write_json(file: Path, content: Any) -> None:
    """Write JSON for people and programs: the old content or the new, nothing in between."""
    unfinished = file.with_name(f".{file.name}.unfinished")
    unfinished.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8")
    unfinished.replace(file)
