"""What people see: progress and tables go to standard error, so that standard output stays clean for ``--json``."""

import json
import os
import signal
import sys
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from threading import Event, Thread
from typing import Any

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    Task,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Table

from mabirds_bringup.watch.eta import eta_text

NEWS = 10.0
"""Seconds between two lines of progress where no terminal is."""

REMEMBERED = 3600.0
"""Seconds of steps by which the time that is left is told: one step may take minutes."""

OF_TRUTH = ("CVR", "SR", "late", "nats", "FDR")
"""Columns of the summary that need the true constraints, or experts who know them."""

console = Console(stderr=True, markup=False, highlight=False)


@contextmanager
def guarded_output() -> Iterator[Any]:
    """Send everything that libraries print to standard output to standard error; yields the real standard output.

    Fast DDS prints its errors to standard output, where they would spoil JSON.
    """
    sys.stdout.flush()
    real = os.dup(1)
    os.dup2(2, 1)
    try:
        with os.fdopen(os.dup(real), "w", encoding="utf-8") as stream:
            yield stream
    finally:
        os.dup2(real, 1)
        os.close(real)


@contextmanager
def ending_as_interrupted() -> Iterator[None]:
    """End as on Ctrl-C when asked by SIGTERM, or when the terminal goes (SIGHUP, unless that is ignored)."""
    numbers = [signal.SIGTERM, *([] if signal.getsignal(signal.SIGHUP) == signal.SIG_IGN else [signal.SIGHUP])]
    before = {number: signal.signal(number, signal.default_int_handler) for number in numbers}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


def print_json(content: Any, stream: Any) -> None:
    """Print ``content`` as exactly one JSON object."""
    print(json.dumps(content), file=stream, flush=True)


@contextmanager
def progress_bar() -> Iterator[Progress]:
    """A bar with count, time and time that is left, for long work; a line every NEWS seconds where no terminal is."""
    counted = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    columns = (*counted, TimeElapsedColumn(), TextColumn("left"), TimeRemainingColumn())
    with Progress(*columns, console=console, speed_estimate_period=REMEMBERED) as bar, _lines(bar):
        yield bar


@contextmanager
def _lines(bar: Progress) -> Iterator[None]:
    """Tell what a bar shows; from a thread, as work may take long before it comes to its first step."""
    done = Event()

    def tell() -> None:
        while not done.wait(NEWS):
            for task in (task for task in bar.tasks if not task.finished):
                console.print(progress_line(task), soft_wrap=True)

    telling = Thread(target=tell, daemon=True)
    if not console.is_terminal:
        telling.start()
    try:
        yield
    finally:
        done.set()
        if telling.is_alive():
            telling.join()


def progress_line(task: Task) -> str:
    """How far a task is, and how long it still takes, in a line."""
    count = f"{task.completed:g}" if task.total is None else f"{task.completed:g}/{task.total:g}"
    left = eta_text(task.time_remaining)
    return f"{task.description} {count}, {eta_text(task.elapsed)}" + (f", {left} left" if left else "")


def summary_table(summary: dict[str, Any]) -> Table:
    """The summary of a run for the terminal, at most 60 columns wide.

    late: the least SR of the last 15 iterations; found: learned constraints; open: features that are undetermined.
    What needs the truth is left out where nobody knows it.
    """
    experts = summary["expert_log_likelihood"]
    caption = None if experts is None else f"the experts' own likelihood {experts:.2f} nats"
    title = f"{summary['experiment']}: constraints by {summary['constraint_rule']}"
    table = _narrow_table(title, caption)
    lines = [_summary_line(name, row) for name, row in summary["learners"].items()]
    for column in lines[0]:
        if column not in OF_TRUTH or any(line[column] for line in lines):
            _add_column(table, column)
    for line in lines:
        table.add_row(*(line[str(column.header)] for column in table.columns))
    return table


def _narrow_table(title: str, caption: str | None) -> Table:
    return Table(title=title, caption=caption, box=None, padding=(0, 1, 0, 0), pad_edge=False)


def _add_column(table: Table, column: str) -> None:
    """Where there is little room, names are folded, never numbers cut."""
    is_name = column in {"learner", "planner"}
    table.add_column(column, justify="left" if is_name else "right", no_wrap=not is_name, overflow="fold")


def _summary_line(name: str, row: Mapping[str, Any]) -> dict[str, str]:
    return {
        "learner": name,
        "n": str(row["iterations"]),
        "CVR": _number(row["violation_rate"], ".4f"),
        "SR": _number(row["success_rate"], ".4f"),
        "late": _number(row["success_late_minimum"], ".4f"),
        "nats": _number(row["held_out_log_likelihood"], ".2f"),
        "found": str(len(row["learned_constraints"])),
        "FDR": _number(row["false_discovery_rate"], ".3f"),
        "open": _number(row["undetermined"], "d"),
    }


def judges_table(summary: dict[str, Any]) -> Table | None:
    """What planners that took no part make of what was learned, for 60 columns; None where there are none."""
    lines = [(name, judge, of) for name, row in summary["learners"].items() for judge, of in row["judges"].items()]
    if not lines:
        return None
    table = _narrow_table("by planners that took no part in the learning", None)
    for column in ("learner", "planner", "CVR", "SR", "V_0", "gap"):
        _add_column(table, column)
    for name, judge, verdict in lines:
        rates = (_number(verdict[key], ".4f") for key in ("violation_rate", "success_rate"))
        table.add_row(name, judge, *rates, _number(verdict["value"], ".2f"), _number(verdict["certificate"], ".3f"))
    return table


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def tell_targets(targets: Iterable[Mapping[str, Any]]) -> None:
    """Which targets of a benchmark are met, a line each: name, value, target, at_most, met."""
    for target in targets:
        verdict, limit = "met   " if target["met"] else "MISSED", "most" if target["at_most"] else "least"
        name = target["name"].replace("_", " ")
        console.print(f"{verdict} {name}: {target['value']:.3g}, at {limit} {target['target']:g}", soft_wrap=True)
