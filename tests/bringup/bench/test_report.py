"""Report directories."""

import json
import subprocess
import sys
from pathlib import Path

import polars as pl
import pytest
from made_up import results

from mabirds_bringup.bench.frame import read_results
from mabirds_bringup.bench.report import Page, machine, write_report
from mabirds_bringup.bench.summary import summarise
from mabirds_bringup.bench.tables import Section
from mabirds_bringup.bench.targets import SCHEMA


def test_the_reports_show_the_tables(tmp_path: Path) -> None:
    table = Section("Rates", ["", "SR"], [["a", "1"], ["b<", "2"]])
    rows = summarise(results())
    page = Page(
        "Bees & <birds>", "How to read it.", ["a.png"], [table], rows, pl.DataFrame(schema=SCHEMA), {"rollouts": 7}
    )
    content = write_report(page, results(), tmp_path, "mabirds bench")
    assert content == json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert set(content) == {"command", "machine", "seeds", "results", "targets", "rollouts"}
    assert read_results(tmp_path).equals(results())
    assert (tmp_path / "report.md").read_text(encoding="utf-8") == (
        "# Bees & <birds>\n\n`mabirds bench`; seeds [1]. How to read it.\n\n"
        "## Rates\n\n|  | SR |\n|---|---|\n| a | 1 |\n| b< | 2 |\n"
        "\n## Targets\n\n|  | value | target |  |\n|---|---|---|---|\n"
    )
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    for part in (
        "<title>Bees &amp; &lt;birds&gt;</title>",
        "<h1>Bees &amp; &lt;birds&gt;</h1>",
        "<tr><th></th><th>SR</th></tr>",
        "<td>b&lt;</td>",
        '<img src="a.png"',
    ):
        assert part in text


def test_the_machine_names_the_packages_that_are_installed() -> None:
    assert set(machine("numpy", "no-such-package")) == {"cores", "threads", "python", "numpy"}


@pytest.mark.parametrize("module", ["cli", "bench.outcome"])
def test_the_processes_of_cases_do_not_load_what_makes_reports(module: str) -> None:
    program = f"import sys, mabirds_bringup.{module}\nprint({{'polars', 'matplotlib', 'jinja2'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "set()\n"
