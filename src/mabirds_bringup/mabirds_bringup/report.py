"""report.html: the summary of a run as one page with its figures."""

from html import escape
from pathlib import Path
from typing import Any

PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font-family: system-ui, sans-serif; margin: 2em auto; max-width: 60em; }}
table {{ border-collapse: collapse; }}
td, th {{ padding: 0.3em 0.8em; border-bottom: 1px solid #ccc; text-align: right; }}
td:first-child, th:first-child {{ text-align: left; }}
img {{ max-width: 100%; }}
</style>
<h1>{title}</h1>
<table>{rows}</table>
<p>{notes}</p>
{figures}
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
    header = "".join(f"<th>{name}</th>" for name in ("learner", *COLUMNS.values()))
    body = "".join(
        f"<tr><td>{escape(name)}</td>" + "".join(f"<td>{_number(row[key])}</td>" for key in COLUMNS) + "</tr>"
        for name, row in summary["learners"].items()
    )
    page = PAGE.format(
        title=escape(f"MA-BIRDS: {summary['experiment']}"),
        rows=f"<tr>{header}</tr>{body}",
        notes=_notes(summary),
        figures="\n".join(f'<p><img src="{name}" alt="{name}"></p>' for name in figures),
    )
    (directory / "report.html").write_text(page, encoding="utf-8")


def _number(value: Any) -> str:
    return f"{value:.3f}" if isinstance(value, float) else str(value)


def _notes(summary: dict[str, Any]) -> str:
    distance = summary["consensus_distance"]
    return (
        f"A constraint counts as learned where its cost -omega exceeds {summary['constraint_threshold']:g}. Rates are"
        f" exact. Consensus distance: theta {distance['theta']:.3g}, omega {distance['omega']:.3g}, policy (total"
        f" variation) {distance['policy']:.3g}. Wall time {summary['wall_seconds']:.1f} s."
    )
