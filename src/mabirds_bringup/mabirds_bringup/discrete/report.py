"""The benchmark's report directory: summary.json, all outcomes, tables as Markdown, report.html with pictures."""

import gzip
import json
import os
import platform
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from mabirds_bringup.discrete.cases import HARD, MAIN, VARIATIONS
from mabirds_bringup.discrete.figures import save_figures
from mabirds_bringup.discrete.outcome import Outcome
from mabirds_bringup.discrete.tables import COLUMNS, rows, table
from mabirds_bringup.discrete.targets import agreement, targets
from mabirds_bringup.report import html_table, image, write_page
from mabirds_bringup.run_directory import write_json
from mabirds_core.experiment import Experiment

OUTCOMES = "outcomes.json.gz"
TARGET_COLUMNS = ("", "value", "target", "")

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
    content = {
        "command": command,
        "machine": {
            "cores": os.cpu_count(),
            "threads": 1,
            "python": platform.python_version(),
            "numpy": np.__version__,
        },
        "seeds": sorted({one.seed for one in outcomes}),
        "same_constraint_set": {str(seed): same for seed, same in agreement(outcomes).items()},
        "results": [asdict(row) for row in rows(outcomes)],
        "targets": [target.as_dict() for target in targets(outcomes)],
    }
    write_json(directory / "summary.json", content)
    with gzip.open(directory / OUTCOMES, "wt", encoding="utf-8") as stream:
        json.dump([asdict(one) for one in outcomes], stream)
    pictures = save_figures(main, hard, outcomes, directory)
    (directory / "report.md").write_text("\n".join(_markdown(main, outcomes, content)) + "\n", encoding="utf-8")
    write_page(directory / "report.html", _title(main), _html(outcomes, content, pictures))
    return content


def earlier_outcomes(directory: Path) -> list[Outcome]:
    """The outcomes that an earlier report in ``directory`` was made of; none where there is no report."""
    if not (directory / OUTCOMES).exists():
        return []
    with gzip.open(directory / OUTCOMES, "rt", encoding="utf-8") as stream:
        return [Outcome(**one) for one in json.load(stream)]


def _title(main: Experiment) -> str:
    return f"{main.name}: MA-BIRDS and central methods, {main.iterations} demonstrations a learner"


def _tables(outcomes: Sequence[Outcome]) -> Iterator[tuple[str, list[list[str]]]]:
    """Title and lines of each group's table."""
    for group, title in GROUPS.items():
        chosen = [row for row in rows(outcomes) if row.group == group]
        if chosen:
            yield title, table(chosen)


def _target_lines(content: dict[str, Any]) -> list[list[str]]:
    return [
        [one["name"], f"{one['value']:.3f}", f"{'<=' if one['at_most'] else '>='} {one['target']:g}", _verdict(one)]
        for one in content["targets"]
    ]


def _verdict(target: dict[str, Any]) -> str:
    return "met" if target["met"] else "missed"


def _markdown(main: Experiment, outcomes: Sequence[Outcome], content: dict[str, Any]) -> Iterator[str]:
    yield from (f"# {_title(main)}", "", f"`{content['command']}`; seeds {content['seeds']}. {NOTE}", "")
    for title, lines in _tables(outcomes):
        yield from (f"## {title}", "", *_markdown_table(COLUMNS, lines), "")
    yield from ("## Targets", "", *_markdown_table(TARGET_COLUMNS, _target_lines(content)))


def _markdown_table(header: Sequence[str], lines: Sequence[Sequence[str]]) -> Iterator[str]:
    yield f"| {' | '.join(header)} |"
    yield "|---" * len(header) + "|"
    yield from (f"| {' | '.join(line)} |" for line in lines)


def _html(outcomes: Sequence[Outcome], content: dict[str, Any], pictures: Sequence[str]) -> Iterator[str]:
    yield f"<p><code>{escape(content['command'])}</code>; seeds {content['seeds']}. {escape(NOTE)}</p>"
    for title, lines in _tables(outcomes):
        yield f"<h2>{escape(title)}</h2>{html_table(COLUMNS, lines)}"
    yield f"<h2>Targets</h2>{html_table(TARGET_COLUMNS, _target_lines(content))}"
    yield from map(image, pictures)
