"""Draw docs/images/architecture.svg: the processes of a network and what travels between them."""

from pathlib import Path
from xml.sax.saxutils import escape

FILE = Path(__file__).resolve().parents[1] / "docs" / "images" / "architecture.svg"
STYLE = (
    "text{font-family:sans-serif;font-size:14px;fill:#222}.name{font-weight:bold}.topic{font-size:12px;fill:#444}"
    "rect{rx:6;stroke:#3f51b5;stroke-width:1.5;fill:#eef0fb}.file{fill:#f5f5f5;stroke:#777}"
    "path{stroke:#333;stroke-width:1.5;fill:none;marker-end:url(#tip)}.both{marker-start:url(#tip)}"
    ".private{stroke:#c62828}.dotted{stroke-dasharray:4 4}"
)
TIP = (
    '<marker id="tip" viewBox="0 0 8 8" refX="7" refY="4" markerWidth="7" markerHeight="7" orient="auto-start-reverse">'
    '<path d="M0 0L8 4L0 8z" style="fill:#333;stroke:none;marker-end:none"/></marker>'
)


def box(x: int, y: int, width: int, lines: list[str], kind: str = "") -> str:
    """A box with a name and what it holds."""
    rect = f'<rect class="{kind}" x="{x}" y="{y}" width="{width}" height="{22 * len(lines) + 14}"/>'
    texts = [label(x + 12, y + 24 + 22 * row, line, "" if row else "name") for row, line in enumerate(lines)]
    return "\n".join([rect, *texts])


def label(x: int, y: int, words: str, kind: str = "topic") -> str:
    """Words at a place."""
    return f'<text class="{kind}" x="{x}" y="{y}">{escape(words)}</text>'


def arrow(way: str, kind: str = "") -> str:
    """A line with a tip; ``way`` in the language of SVG paths."""
    return f'<path class="{kind}" d="{way}"/>'


def drawing() -> str:
    """The picture as SVG."""
    parts = [
        box(20, 20, 200, ["bag", "rosbag2, MCAP"], "file"),
        box(20, 140, 200, ["expert_player", "rate, flow control", "mabirds_expert_player"]),
        box(440, 20, 220, ["learner_1", "its own demonstrations", "theta, omega"]),
        box(440, 150, 220, ["learner_2", "its own demonstrations", "theta, omega"]),
        box(440, 280, 220, ["learner_N", "its own demonstrations", "theta, omega"]),
        box(860, 20, 220, ["mabirds run", "starts, restarts, records", "run directory, report"]),
        box(860, 210, 220, ["mabirds inspect", "shows"]),
        box(20, 280, 200, ["experiment.yaml", "game, E(n), seeds:", "every process reads it"], "file"),
        arrow("M120 78V140"),
        arrow("M220 165C330 165 330 60 440 60", "private"),
        arrow("M220 180H440", "private"),
        arrow("M220 195C330 195 330 320 440 320", "private"),
        label(240, 50, "/learner_v/demonstration:"),
        label(240, 67, "to learner v and nobody else"),
        arrow("M550 100V150", "both"),
        arrow("M550 230V280", "both"),
        label(560, 130, "/learner_v/parameters"),
        label(560, 260, "along E(n), mixed by W(n)"),
        arrow("M660 50H860"),
        arrow("M660 185C760 185 760 75 860 75"),
        arrow("M660 195C760 195 760 235 860 235", "dotted"),
        label(680, 42, "parameters, status"),
    ]
    size = 'width="1100" height="380" viewBox="0 0 1100 380"'
    head = f'<svg xmlns="http://www.w3.org/2000/svg" {size}>\n<style>{STYLE}</style>\n<defs>{TIP}</defs>'
    return "\n".join([head, *parts, "</svg>"]) + "\n"


if __name__ == "__main__":
    FILE.write_text(drawing(), encoding="utf-8")
