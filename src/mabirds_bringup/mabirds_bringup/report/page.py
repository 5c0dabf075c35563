"""report.html: the summary of a run as one page with its figures."""

from collections.abc import Iterable, Sequence
from html import escape
from pathlib import Path
from typing import Any

PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font-family: system-ui, sans-serif; margin: 2em auto; max-width: 72em; }}
table {{ border-collapse: collapse; }}
td, th {{ padding: 0.3em 0.8em; border-bottom: 1px solid #ccc; text-align: right; }}
td:first-child, th:first-child {{ text-align: left; }}
img {{ max-width: 100%; }}
</style>
<h1>{title}</h1>
{content}
</html>
"""

COLUMNS = {
    "iterations": "iterations",
    "violation_rate": "CVR",
    "success_rate": "SR",
    "false_positive_rate": "FPR",
    "false_negative_rate": "FNR",
}


def write_report(directory: Path, summary: dict[str, Any], figures: list[str]) -> None:
    """Write report.html beside the figures that it shows."""
    lines = [[name, *(_number(row[key]) for key in COLUMNS)] for name, row in summary["learners"].items()]
    content = [html_table(["learner", *COLUMNS.values()], lines), f"<p>{_notes(summary)}</p>", *map(image, figures)]
    write_page(directory / "report.html", f"MA-BIRDS: {summary['experiment']}", content)


def write_page(file: Path, title: str, content: Iterable[str]) -> None:
    """One HTML page of ready parts."""
    file.write_text(PAGE.format(title=escape(title), content="\n".join(content)), encoding="utf-8")


def html_table(header: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table; the first column names its rows."""
    head = "".join(f"<th>{escape(name)}</th>" for name in header)
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in line) + "</tr>" for line in lines)
    return f"<table><tr>{head}</tr>{body}</table>"


def image(name: str) -> str:
    """A picture beside the page."""
    return f'<p><img src="{escape(name)}" alt="{escape(name)}"></p>'


def _number(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _notes(summary: dict[str, Any]) -> str:
    distance = summary["consensus_distance"]
    return (
        f"A constraint counts as learned where its cost -omega exceeds {summary['constraint_threshold']:g}. Rates are"
        f" {summary['rates']}. Consensus distance: theta {distance['theta']:.3g}, omega {distance['omega']:.3g}, policy"
        f" (total variation) {distance['policy']:.3g}. Wall time {summary['wall_seconds']:.1f} s."
    )
