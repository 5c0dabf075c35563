"""A benchmark's report directory: summary.json, all results, tables as Markdown, report.html with pictures."""

import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import polars as pl

from mabirds_bringup.bench.frame import write_results
from mabirds_bringup.bench.summary import Measure, summarise
from mabirds_bringup.bench.tables import Column, Section, section
from mabirds_bringup.bench.targets import COLUMNS, Limits
from mabirds_bringup.report.templates import render
from mabirds_bringup.run.run_directory import write_json


@dataclass(frozen=True)
class Benchmark:
    """What a benchmark shows of its results, as queries. ``groups``: titles of the groups' tables, in order."""

    groups: Mapping[str, str]
    measures: Mapping[str, Measure]
    columns: Sequence[Column]
    limits: Sequence[Limits]
    packages: Sequence[str]
    """On which times depend."""

    def rows(self, results: pl.DataFrame) -> pl.DataFrame:
        """One row per learner or method of each case, over all seeds."""
        return summarise(results, self.measures)

    def sections(self, rows: pl.DataFrame) -> list[Section]:
        """A table of each group that there is."""
        of = {title: rows.filter(group=group) for group, title in self.groups.items()}
        return [section(title, own, self.columns) for title, own in of.items() if len(own)]

    def targets(self, rows: pl.DataFrame) -> pl.DataFrame:
        """Targets of all limits, in order."""
        return pl.concat([limits.targets(rows) for limits in self.limits])


@dataclass(frozen=True)
class Page:
    """What report.md and report.html say, and summary.json. ``note``: how to read the tables."""

    title: str
    note: str
    pictures: Sequence[str]
    sections: Sequence[Section]
    targets: pl.DataFrame
    content: Mapping[str, Any] = field(default_factory=dict)
    """More of summary.json."""


def machine(*packages: str) -> dict[str, Any]:
    """What the times depend on, with the versions of ``packages``."""
    return {
        "cores": os.cpu_count(),
        "threads": 1,
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def write_report(
    benchmark: Benchmark, results: pl.DataFrame, directory: Path, command: str, page: Page
) -> dict[str, Any]:
    """Fill ``directory``, where the pictures are already; returns what --json prints."""
    content = {
        "command": command,
        "machine": machine(*benchmark.packages),
        "seeds": sorted(results["seed"].unique()),
        "results": benchmark.rows(results).drop("name").to_dicts(),
        "targets": page.targets.to_dicts(),
        **page.content,
    }
    write_json(directory / "summary.json", content)
    write_results(directory, results)
    sections = [*page.sections, section("Targets", page.targets, COLUMNS)]
    for suffix in ("md", "html"):
        text = render(f"bench.{suffix}.jinja", **content, page=page, sections=sections)
        (directory / f"report.{suffix}").write_text(text, encoding="utf-8")
    return content
