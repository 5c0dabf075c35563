"""A benchmark's report directory: summary.json, all results, tables as Markdown, report.html with pictures."""

import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from importlib.metadata import PackageNotFoundError, version
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
    content : Mapping
        More of summary.json.
    """

    title: str
    note: str
    pictures: Sequence[str]
    sections: Sequence[Section]
    rows: pl.DataFrame
    targets: pl.DataFrame
    content: Mapping[str, Any] = field(default_factory=dict)


def machine(*packages: str) -> dict[str, Any]:
    """What the times depend on, with the versions of ``packages`` that are installed."""
    installed = dict[str, str]()
    for package in packages:
        with suppress(PackageNotFoundError):
            installed[package] = version(package)
    return {"cores": os.cpu_count(), "threads": 1, "python": platform.python_version(), **installed}


def write_report(page: Page, results: pl.DataFrame, directory: Path, command: str) -> dict[str, Any]:
    """Fill ``directory``, where the pictures are already; returns what --json prints."""
    content = {
        "command": command,
        "machine": machine("numpy", "scipy", "torch"),
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
