"""The benchmark's report."""

from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mabirds_bringup.bench import report
from mabirds_bringup.bench.discrete.cases import HARD, MAIN, VARIATIONS
from mabirds_bringup.bench.discrete.figures import save_figures
from mabirds_bringup.bench.discrete.outcome import Outcome
from mabirds_bringup.bench.discrete.tables import COLUMNS, rows, table
from mabirds_bringup.bench.discrete.targets import agreement, targets
from mabirds_bringup.bench.report import Page, Section, machine
from mabirds_bringup.bench.targets import COLUMNS as TARGET_COLUMNS
from mabirds_bringup.bench.targets import Target, target_lines
from mabirds_core.experiment.file import Experiment

GROUPS = {
    MAIN: "Tables 1 and 2: all methods on the same demonstrations",
    HARD: "The game with many starts",
    VARIATIONS: "Variations of MA-BIRDS on the first game",
}
NOTE = (
    "Mean ± half the range over the seeds. Rates are exact. STPOI: time per online iteration; 50% ST, 90% ST: time of"
    " updates until SR first is that high; each divided by the smallest of its column. Gradient steps and policy solves"
    " are counted per online iteration, seconds are per online iteration of one learner on one thread."
)


def write_report(
    main: Experiment, hard: Experiment, outcomes: Sequence[Outcome], directory: Path, command: str
) -> dict[str, Any]:
    """Fill ``directory``; returns what --json prints."""
    found = targets(outcomes)
    content = {
        "command": command,
        "machine": machine("numpy"),
        "seeds": sorted({one.seed for one in outcomes}),
        "same_constraint_set": {str(seed): same for seed, same in agreement(outcomes).items()},
        "results": [asdict(row) for row in rows(outcomes)],
        "targets": [target.as_dict() for target in found],
    }
    title = f"{main.name}: MA-BIRDS and central methods, {main.iterations} demonstrations a learner"
    pictures = save_figures(main, hard, outcomes, directory)
    report.write_report(directory, content, outcomes, Page(title, NOTE, list(_sections(outcomes, found)), pictures))
    return content


def _sections(outcomes: Sequence[Outcome], found: Sequence[Target]) -> Iterator[Section]:
    for group, title in GROUPS.items():
        chosen = [row for row in rows(outcomes) if row.group == group]
        if chosen:
            yield Section(title, COLUMNS, table(chosen))
    yield Section("Targets", TARGET_COLUMNS, target_lines(found))
