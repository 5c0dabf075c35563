"""report.html: the summary of a run as one page with its figures."""

from pathlib import Path
from typing import Any

from mabirds_bringup.report.templates import render


def write_report(directory: Path, summary: dict[str, Any], figures: list[str]) -> None:
    """Write report.html beside the figures that it shows."""
    page = render("run.html.jinja", **summary, figures=figures)
    (directory / "report.html").write_text(page, encoding="utf-8")
