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
from mabirds_bringup.bench.tables import Section, section
from mabirds_bringup.bench.targets import COLUMNS
from mabirds_bringup.report.templates import render
from mabirds_bringup.run.run_directory import write_json


@dataclass(frozen=True)
class Page:
    """What a report shows.

    Attributes
    ----------
    title, note : str
        The heading, and how to read the tables.
    pictures : Sequence of str
        Files that are in the directory.
    sections : Sequence of Section
        Tables.
    rows, targets : DataFrame
        ``results`` and ``targets`` of summary.json.
    packages : Sequence of str
        On which times depend.
    content : Mapping
        More of summary.json.
    """

    title: str
    note: str
    pictures: Sequence[str]
    sections: Sequence[Section]
    rows: pl.DataFrame
    targets: pl.DataFrame
    packages: Sequence[str] = ("numpy",)
    content: Mapping[str, Any] = field(default_factory=dict)


def machine(*packages: str) -> dict[str, Any]:
    """What the times depend on, with the versions of ``packages``."""
    return {
        "cores": os.cpu_count(),
        "threads": 1,
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def write_report(page: Page, results: pl.DataFrame, directory: Path, command: str) -> dict[str, Any]:
    """Fill ``directory``, where the pictures are already; returns what --json prints."""
    content = {
        "command": command,
        "machine": machine(*page.packages),
        "seeds": sorted(results["seed"].unique()),
        "results": page.rows.drop("name").to_dicts(),
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
