"""The report: one table of all forecasts, differences to the learners, targets, pictures."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import polars as pl

from mabirds_bringup.bench.frame import frame_of
from mabirds_bringup.bench.pedestrians.features import LEVELS
from mabirds_bringup.bench.pedestrians.figures import save_figures
from mabirds_bringup.bench.pedestrians.judging import MEASURES
from mabirds_bringup.bench.pedestrians.measure import CONSTANT, TOLD, Findings, Sizes, mean_costs, wall_cost
from mabirds_bringup.bench.report import Page, write_report
from mabirds_bringup.bench.results import CaseResult, entries
from mabirds_bringup.bench.tables import NAME, Column, Section, section
from mabirds_bringup.bench.targets import judged as with_verdicts
from mabirds_bringup.evaluate.recordings import LEARNERS, Estimate

TITLE = "Pedestrians: learned from 60 % of the time, judged by the rest"
NOTE = (
    "Pairs of people who walk towards each other; those who meet several people are in several pairs, and intervals"
    " (95 %) draw people anew, not pairs. Nats: by which a step of a walker is likelier than under uniform moves;"
    " all are told in the same moves and told the first step of each walker. ADE, FDE: average and final displacement"
    " [m], mean of the ways drawn and best of them. All settings and noises are from the first 60 % of the time."
    " Constant velocity: nats with Gaussian noise in each step; ways with one deviation each, which is the one whose"
    " best ways are nearest to the training; deviation told: to the held-out pairs, which nobody can know. Data:"
    " Lerner, Chrysanthou, Lischinski, Crowds by Example, Computer Graphics Forum 26(3), 2007."
)


def write_pedestrians(findings: Findings, sizes: Sizes, directory: Path, command: str) -> dict[str, Any]:
    """Fill ``directory``; returns what --json prints."""
    rows = _rows(findings)
    pictures = save_figures(findings, sizes.seed, directory)
    sections = [_forecasts(rows, sizes.samples), _differences(findings, sizes.samples), _import(findings)]
    content = {"settings": {"lookahead": findings.choice.lookahead, "iterations": findings.choice.iterations}}
    page = Page(TITLE, NOTE, pictures, sections, rows, targets(findings, sizes.samples), content)
    return write_report(page, _results(findings, sizes.seed), directory, command)


def _rows(findings: Findings) -> pl.DataFrame:
    """A line per forecast with all estimates."""
    judged = findings.judged
    lines = [
        {"name": name, "forecast": name} | {of: judged.estimate(name, of)._asdict() for of in MEASURES}
        for name in judged.by_name
    ]
    return pl.DataFrame(lines)


def _text(cell: Mapping[str, float]) -> str:
    return str(Estimate(**cell))


def _forecasts(rows: pl.DataFrame, samples: int) -> Section:
    titles = ("nats a step", "ADE [m]", f"best of {samples}", "FDE [m]", f"best of {samples} ")
    columns = (Column(title, pl.col(of), _text) for title, of in zip(titles, MEASURES, strict=True))
    return section("Held-out pairs", rows, [NAME, *columns])


def _differences(findings: Findings, samples: int) -> Section:
    """By how much the learners' mean is above others, pair by pair."""
    judged = findings.judged
    others = [name for name in judged.by_name if name != LEARNERS]
    lines = [
        [name, *(str(judged.estimate(LEARNERS, of, name)) for of in ("nats", "average_best", "final_best"))]
        for name in others
    ]
    titles = ["", "nats a step", f"ADE, best of {samples} [m]", f"FDE, best of {samples} [m]"]
    return Section("The learners' mean less the others, pair by pair", titles, lines)


def _import(findings: Findings) -> Section:
    lines = [[name, str(count)] for name, count in findings.imported.items()]
    counts = [["pairs that are learned from", str(len(findings.training))], ["held out", str(len(findings.held_out))]]
    return Section("The import", ["", ""], [*counts, *lines])


def targets(findings: Findings, samples: int) -> pl.DataFrame:
    """What is to be shown: every baseline is beaten in nats, constant velocity in ways; what costs, and nobody told."""
    judged = findings.judged
    baselines = [name for name in judged.by_name if name not in {LEARNERS, TOLD, *findings.policies}]
    nearness = float(mean_costs(findings.policies)[1][1:].sum())
    least = [(f"nats a step above {name}", judged.estimate(LEARNERS, "nats", name).mean) for name in baselines]
    least += [
        (f"cost of being within {LEVELS[0]:g} to {LEVELS[1]:g} m [nats]", nearness),
        ("cost of places at walls above where people walk [nats]", wall_cost(findings)),
    ]
    most = judged.estimate(LEARNERS, "average_best", CONSTANT).mean
    lines = [{"name": name, "value": value, "target": 0.0, "at_most": False} for name, value in least]
    name = f"ADE, best of {samples}, less that of {CONSTANT} [m]"
    return with_verdicts(pl.DataFrame([*lines, {"name": name, "value": most, "target": 0.0, "at_most": True}]))


def _results(findings: Findings, seed: int) -> pl.DataFrame:
    """Every measure of every pair and forecast."""
    return frame_of(
        CaseResult("held-out", name, name, seed, [*entries(0, **dict(zip(MEASURES, values, strict=True)))])
        for name, values in findings.judged.by_name.items()
    )
