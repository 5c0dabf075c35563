"""The report of a declared study: tables by group, what it was to show, and pictures."""

from pathlib import Path
from typing import Any

import polars as pl

from mabirds_bringup.bench.figures import save_figures
from mabirds_bringup.bench.report import Page, write_report
from mabirds_bringup.bench.study import LoadedStudy
from mabirds_bringup.bench.summary import summarise
from mabirds_bringup.bench.tables import NAME, TIMES, WORK, Section, agreement_section, entries_section, rate, section
from mabirds_bringup.bench.targets import SCHEMA as TARGETS
from mabirds_bringup.bench.targets import targets_of


def sections(study: LoadedStudy, results: pl.DataFrame) -> list[Section]:
    """A table of each group that there is, how far learners are apart, and the games' own measures."""
    rows, settings = summarise(results), study.settings
    columns = (NAME, *(rate(title, measure) for title, measure in settings.columns.items()), *TIMES, *WORK)
    groups = [section(group.title, rows.filter(group=name), columns) for name, group in settings.groups.items()]
    tables = [
        entries_section(table.title, results.filter(group=table.group, label=table.label), table.columns)
        for table in settings.tables
    ]
    return [table for table in (*groups, agreement_section(rows), *tables) if table.lines]


def targets(study: LoadedStudy, rows: pl.DataFrame) -> pl.DataFrame:
    """All targets of the groups that there are, in order."""
    none = pl.DataFrame(schema=TARGETS)
    return pl.concat([none, *(targets_of(target, rows) for target in study.settings.targets)])


def write_study(study: LoadedStudy, results: pl.DataFrame, directory: Path, command: str) -> dict[str, Any]:
    """Fill ``directory``; returns what --json prints."""
    rows = summarise(results)
    page = Page(
        study.title,
        study.note,
        save_figures(study, results, directory),
        sections(study, results),
        rows,
        targets(study, rows),
        {"rollouts": study.settings.rollouts},
    )
    return write_report(page, results, directory, command)
