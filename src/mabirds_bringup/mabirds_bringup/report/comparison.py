"""Several runs side by side: rates, what their settings differ in, and how success grew."""

import csv
import json
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.figure import Figure

from mabirds_bringup.report.embedding import embedded
from mabirds_bringup.report.figures import DOTS_PER_INCH, legend_beside
from mabirds_bringup.report.measures import MEASURES, shown
from mabirds_bringup.report.templates import render
from mabirds_core.errors import MabirdsError

COLUMNS = ("run", "learner", "iterations", *(measure.title for measure in MEASURES), "wall time [s]")


class UnjudgedRunError(MabirdsError):
    """A run has no rates to compare."""


class JudgedRun(NamedTuple):
    """A run that has been judged.

    Attributes
    ----------
    name : str
        Of its directory.
    summary : dict[str, Any]
        Of summary.json.
    settings : dict[str, Any]
        Of manifest.json.
    success : dict[int, float]
        By iteration, the mean success rate of all learners.
    """

    name: str
    summary: dict[str, Any]
    settings: dict[str, Any]
    success: dict[int, float]


def load_judged(directory: Path) -> JudgedRun:
    """Read a run directory.

    Raises
    ------
    UnjudgedRunError
        It has not been judged.
    """
    files = {name: directory / name for name in ("summary.json", "manifest.json", "metrics.csv")}
    if missing := [name for name, file in files.items() if not file.is_file()]:
        raise UnjudgedRunError(f"{directory}: no {missing[0]}; run `mabirds report {directory}` first")
    summary, manifest = (json.loads(files[name].read_text(encoding="utf-8")) for name in list(files)[:2])
    if not summary.get("learners"):
        raise UnjudgedRunError(f"{directory}: has no rates; run `mabirds report {directory}` first")
    return JudgedRun(directory.name, summary, dict(_leaves(manifest["settings"])), _success(files["metrics.csv"]))


def _success(file: Path) -> dict[int, float]:
    by_iteration: dict[int, list[float]] = {}
    with file.open(newline="", encoding="utf-8") as stream:
        for row in csv.DictReader(stream):
            if row["success_rate"]:  # empty where nobody knows the truth
                by_iteration.setdefault(int(row["iteration"]), []).append(float(row["success_rate"]))
    return {iteration: sum(rates) / len(rates) for iteration, rates in sorted(by_iteration.items())}


def _leaves(content: Any, prefix: str = "") -> Iterator[tuple[str, str]]:
    """Settings by their paths, such as algorithm.window."""
    if isinstance(content, Mapping) and content:
        for name, value in content.items():
            yield from _leaves(value, f"{prefix}.{name}" if prefix else name)
    else:
        yield prefix, json.dumps(content)


def lines(runs: Sequence[JudgedRun]) -> list[list[str]]:
    """A line of rates for each run and learner."""
    return [
        [
            run.name,
            name,
            str(row["iterations"]),
            *(shown(row[measure.key], measure.form) for measure in MEASURES),
            f"{run.summary['wall_seconds']:.1f}",
        ]
        for run in runs
        for name, row in run.summary["learners"].items()
    ]


def differences(runs: Sequence[JudgedRun]) -> list[list[str]]:
    """A line for each setting that not all runs have alike: its path, and its value in each."""
    paths = dict.fromkeys(path for run in runs for path in run.settings)
    values = ([path, *(run.settings.get(path, "") for run in runs)] for path in paths)
    return [line for line in values if len(set(line[1:])) > 1]


def best(runs: Sequence[JudgedRun]) -> str:
    """Which run ends with the best success of its worst learner, in a sentence."""
    known = {run.name: [row["success_rate"] for row in run.summary["learners"].values()] for run in runs}
    worst = {name: min(rates) for name, rates in known.items() if None not in rates}
    if not worst:
        return "Nobody knows the true constraints of any run."
    ranked = sorted(worst, key=lambda name: -worst[name])
    words = ", ".join(f"{name} {worst[name]:.3f}" for name in ranked)
    return f"Success of the worst learner of each run at its end, the best first: {words}."


def success_figure(runs: Sequence[JudgedRun]) -> Figure:
    """Mean success rate of each run's learners."""
    figure, axis = plt.subplots(figsize=(9, 3.6), layout="constrained")
    for run in runs:
        axis.plot([n - 1 for n in run.success], list(run.success.values()), marker="o", ms=3, label=run.name)
    axis.set(xlabel="demonstrations learned", ylabel="SR, mean of all learners", ylim=(-0.02, 1.02))
    axis.set_title("how success grew", fontsize=10)
    legend_beside(axis)
    return figure


def write_comparison(runs: Sequence[JudgedRun], directory: Path) -> None:
    """Write report.html, report.md and success.png into a directory."""
    directory.mkdir(parents=True, exist_ok=True)
    figure = success_figure(runs)
    figure.savefig(directory / "success.png", dpi=DOTS_PER_INCH)
    plt.close(figure)
    words = "Success rate against demonstrations, a line for each run."
    content = {
        "title": f"{len(runs)} runs compared",
        "best": best(runs),
        "columns": COLUMNS,
        "lines": lines(runs),
        "names": ["setting", *(run.name for run in runs)],
        "differences": differences(runs),
        "measures": MEASURES,
        "words": words,
    }
    picture = embedded(directory / "success.png", words)
    for suffix, figures in (("html", [picture]), ("md", ["success.png"])):
        text = render(f"comparison.{suffix}.jinja", **content, figures=figures)
        (directory / f"report.{suffix}").write_text(text, encoding="utf-8")
