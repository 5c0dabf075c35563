"""report.html and report.md of a run: what was learned, in words, numbers and pictures."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from mabirds_bringup.report.embedding import embedded
from mabirds_bringup.report.findings import findings
from mabirds_bringup.report.measures import MEASURES, Measure, shown
from mabirds_bringup.report.said import NOTHING, TIMES, Said, timings
from mabirds_bringup.report.templates import render
from mabirds_bringup.report.traffic import traffic

CONFIDENCE = (
    "A number is a confidence: how likely demonstrations would have had the feature by now if experts were free to."
    " Nothing: that learner does not take it for a constraint."
)
"""What a table of constraints means."""

FILES = ("logs", "bag", "metrics.csv", "summary.json", "manifest.json", "experiment.yaml")
"""What a report links to, where it is there."""


class _Dumper(yaml.SafeDumper):
    """Writes texts of several lines, such as maps, as they are."""


_Dumper.add_representer(
    str,
    lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style="|" if "\n" in text else None),
)


def write_report(directory: Path, summary: Mapping[str, Any], figures: Mapping[str, str], told: Said = NOTHING) -> None:
    """Write the report of a run directory.

    Parameters
    ----------
    directory : Path
        With the figures.
    summary : Mapping[str, Any]
        Of summary.json.
    figures : Mapping[str, str]
        Names of PNG files, and what each shows.
    told : Said, optional
        What learners said of themselves.
    """
    content = {
        **summary,
        "findings": findings(summary),
        "columns": ["learner", "iterations", *(measure.title for measure in known(summary))],
        "lines": lines(summary),
        "measures": known(summary),
        "shown": shown,
        "judged": judged(summary),
        "constraints": constraints(summary),
        "confidence": CONFIDENCE,
        "manifest": manifest(directory),
        "traffic": traffic(directory),
        "times": TIMES,
        "timings": timings(told),
        "links": [name for name in FILES if (directory / name).exists()],
        "delivered": summary.get("delivered_graph"),
    }
    pictures = {name: embedded(directory / name, words) for name, words in figures.items()}
    for suffix, shown_figures in (("html", list(pictures.values())), ("md", figures)):
        page = render(f"run.{suffix}.jinja", **content, figures=shown_figures)
        (directory / f"report.{suffix}").write_text(page, encoding="utf-8")


def known(summary: Mapping[str, Any]) -> list[Measure]:
    """What can be told of some learner; of what nobody knows the truth of, less."""
    rows = summary["learners"].values()
    return [measure for measure in MEASURES if any(row[measure.key] is not None for row in rows)]


def lines(summary: Mapping[str, Any]) -> list[list[str]]:
    """A line of the table of rates for each learner."""
    return [
        [name, str(row["iterations"]), *(shown(row[measure.key], measure.form) for measure in known(summary))]
        for name, row in summary["learners"].items()
    ]


def constraints(summary: Mapping[str, Any]) -> list[list[str]]:
    """A line for each learned constraint, the surest first: its confidence for each learner, or that there is none."""
    learned = [row["learned_constraints"] for row in summary["learners"].values()]
    surest = {name: max(of.get(name) or 0.0 for of in learned) for of in learned for name in of}
    names = sorted(surest, key=lambda name: -surest[name])
    return [[name, *(_confidence(of, name) for of in learned)] for name in names]


def _confidence(learned: Mapping[str, float | None], name: str) -> str:
    if name not in learned:
        return ""
    value = learned[name]
    return "yes" if value is None else f"{value:.3f}"


def judged(summary: Mapping[str, Any]) -> list[list[str]]:
    """A line for each learner and planner that took no part in the learning."""
    return [
        [
            name,
            judge,
            *(shown(verdict[rate], ".3f") for rate in ("violation_rate", "success_rate")),
            shown(verdict["value"], ".2f"),
            shown(verdict["certificate"], ".3f"),
            shown(verdict["held_out_log_likelihood"], ".2f"),
            shown(verdict["fixed_log_likelihood"], ".2f"),
        ]
        for name, row in summary["learners"].items()
        for judge, verdict in row["judges"].items()
    ]


def manifest(directory: Path) -> dict[str, Any]:
    """How the run came about, with its settings as YAML; nothing where that is not written down."""
    file = directory / "manifest.json"
    if not file.is_file():
        return {}
    content = json.loads(file.read_text(encoding="utf-8"))
    settings = yaml.dump(content.get("settings", {}), Dumper=_Dumper, sort_keys=False, allow_unicode=True)
    return {**content, "settings_text": settings}
