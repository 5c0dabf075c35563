"""A benchmark's report directory: summary.json, all outcomes, tables as Markdown, report.html with pictures."""

import gzip
import json
import os
import platform
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from html import escape
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

from mabirds_bringup.bench.tables import markdown_table
from mabirds_bringup.report.page import html_table, image, write_page
from mabirds_bringup.run.run_directory import write_json

if TYPE_CHECKING:
    from _typeshed import DataclassInstance

OUTCOMES = "outcomes.json.gz"

Outcome = TypeVar("Outcome")


@dataclass(frozen=True)
class Section:
    """One table of the report."""

    title: str
    columns: Sequence[str]
    lines: Sequence[Sequence[str]]


@dataclass(frozen=True)
class Page:
    """What report.md and report.html say. ``note``: how to read the tables."""

    title: str
    note: str
    sections: Sequence[Section]
    pictures: Sequence[str]


def machine(*packages: str) -> dict[str, Any]:
    """What the times depend on, with the versions of ``packages``."""
    return {
        "cores": os.cpu_count(),
        "threads": 1,
        "python": platform.python_version(),
        **{package: version(package) for package in packages},
    }


def write_report(directory: Path, content: dict[str, Any], outcomes: "Sequence[DataclassInstance]", page: Page) -> None:
    """Fill ``directory``, where the pictures are already. ``content``: of summary.json, with command and seeds."""
    write_json(directory / "summary.json", content)
    with gzip.open(directory / OUTCOMES, "wt", encoding="utf-8") as stream:
        json.dump([asdict(one) for one in outcomes], stream)
    (directory / "report.md").write_text("\n".join(_markdown(content, page)) + "\n", encoding="utf-8")
    write_page(directory / "report.html", page.title, _html(content, page))


def earlier_outcomes(directory: Path, make: Callable[..., Outcome]) -> list[Outcome]:
    """The outcomes that an earlier report in ``directory`` was made of; none where there is no report."""
    if not (directory / OUTCOMES).exists():
        return []
    with gzip.open(directory / OUTCOMES, "rt", encoding="utf-8") as stream:
        return [make(**one) for one in json.load(stream)]


def _markdown(content: dict[str, Any], page: Page) -> Iterator[str]:
    yield from (f"# {page.title}", "", f"`{content['command']}`; seeds {content['seeds']}. {page.note}")
    for section in page.sections:
        yield from ("", f"## {section.title}", "", *markdown_table(section.columns, section.lines))


def _html(content: dict[str, Any], page: Page) -> Iterator[str]:
    yield f"<p><code>{escape(content['command'])}</code>; seeds {content['seeds']}. {escape(page.note)}</p>"
    for section in page.sections:
        yield f"<h2>{escape(section.title)}</h2>{html_table(section.columns, section.lines)}"
    yield from map(image, page.pictures)
