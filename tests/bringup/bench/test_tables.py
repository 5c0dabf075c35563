"""The one table of results, what is asked of it, and the reports that are made of it."""

import json
import subprocess
import sys
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import polars as pl
import pytest

from mabirds_bringup.bench.figures import draw_band, rates_figure
from mabirds_bringup.bench.frame import SCHEMA, array_of, frame_of, name, read_results, write_results
from mabirds_bringup.bench.report import Benchmark, Page, write_report
from mabirds_bringup.bench.results import CaseResult, MetricsRow, curve, entries
from mabirds_bringup.bench.summary import MEASURES, MeanRange, mean_of_all, mean_range
from mabirds_bringup.bench.tables import Column, Section, number, rate, scaled, section
from mabirds_bringup.bench.targets import COLUMNS, Limit, Limits


def result(*rows: MetricsRow, learner: str = "learner_1", seed: int = 1) -> CaseResult:
    return CaseResult("main", "MA-BIRDS", learner, seed, list(rows))


def test_every_number_is_a_row_in_order() -> None:
    made_up = result(*curve("success_rate", [0.0, 0.5]), *curve("seconds", [2.0], first=1), *entries(1, work=[[3, 4]]))
    frame = frame_of([made_up, result(MetricsRow(0, "success_rate", 1.0), seed=2)])
    assert frame.schema == SCHEMA
    assert frame.select("seed", "iteration", "metric", "value").rows() == [
        (1, 0, "success_rate", 0.0),
        (1, 1, "success_rate", 0.5),
        (1, 1, "seconds", 2.0),
        (1, 1, "work[0,0]", 3.0),
        (1, 1, "work[0,1]", 4.0),
        (2, 0, "success_rate", 1.0),
    ]
    assert frame_of([]).schema == SCHEMA


@pytest.mark.parametrize("shape", [(1,), (12,), (3, 4), (2, 11, 1, 2)])
def test_an_array_comes_back_in_its_shape(shape: tuple[int, ...]) -> None:
    values = np.random.default_rng(1).normal(size=shape)
    frame = frame_of([result(*entries(3, omega=values, omega_of_others=[7.0]))])
    np.testing.assert_array_equal(array_of(frame, "omega"), values)


def test_what_is_written_is_read_again(tmp_path: Path) -> None:
    assert read_results(tmp_path).equals(frame_of([]))
    frame = frame_of([result(*curve("success_rate", [0.1, 1 / 3]))])
    write_results(tmp_path, frame)
    assert read_results(tmp_path).equals(frame)


def test_the_name_tells_learners_of_a_case_apart() -> None:
    frame = frame_of([result(MetricsRow(0, "seconds", 1.0), learner=learner) for learner in ("learner_2", "bics")])
    assert frame.select(name())["name"].to_list() == ["MA-BIRDS learner_2", "MA-BIRDS"]


def test_a_mean_range_is_the_mean_and_half_of_the_range() -> None:
    found = pl.DataFrame({"rate": [0.1, 0.2, 0.6]}).select(mean_range(pl.col("rate"))).item()
    assert found == pytest.approx({"mean": 0.3, "half_width": 0.25})
    assert str(MeanRange(**found)) == "0.300 ± 0.250"
    assert pl.DataFrame({"rate": [None]}).select(mean_range(pl.col("rate").cast(pl.Float64))).item() is None


def test_a_mean_of_all_needs_all() -> None:
    frame = pl.DataFrame({"known": [1.0, 2.0], "unknown": [1.0, None]})
    found = frame.select(mean_of_all(pl.col("known")).alias("known"), mean_of_all(pl.col("unknown")).alias("unknown"))
    assert found.row(0) == (1.5, None)


def test_columns_that_no_row_has_are_left_out() -> None:
    rows = pl.DataFrame({"name": ["a", "b"], "seconds": [0.0, 3.0], "rate": [None, {"mean": 0.1, "half_width": 0.0}]})
    columns = (
        Column("", pl.col("name")),
        Column("time", scaled(pl.col("seconds")), number(".1f")),
        rate("rate", "rate", optional=True),
    )
    shown = section("title", rows, columns)
    assert shown == Section("title", ["", "time", "rate"], [["a", "0.0", ""], ["b", "1.0", "0.100 ± 0.000"]])
    assert section("title", rows.head(1), columns).columns == ["", "time"]
    assert section("title", rows.clear(), columns).lines == []


def test_limits_are_for_the_labels_and_rows_that_have_them() -> None:
    rows = pl.DataFrame(
        {
            "group": ["main", "main", "main", "hard"],
            "label": ["FTL", "DLM", "BICS", "FTL"],
            "name": ["FTL", "DLM", "BICS", "FTL"],
            "rate": [0.2, None, 0.9, 0.9],
            "success": [0.5, 0.5, 0.5, 0.5],
        }
    )
    rates = Limit("rate", pl.col("rate"), {"FTL": 0.1, "DLM": 0.1}, at_most=True)
    found = Limits("main", [rates, Limit("success", pl.col("success"), {"FTL": 0.5})]).targets(rows)
    assert found.rows(named=True) == [
        {"name": "FTL rate", "value": 0.2, "target": 0.1, "at_most": True, "met": False},
        {"name": "FTL success", "value": 0.5, "target": 0.5, "at_most": False, "met": True},
    ]
    assert section("Targets", found, COLUMNS).lines == [
        ["FTL rate", "0.200", "<= 0.1", "missed"],
        ["FTL success", "0.500", ">= 0.5", "met"],
    ]


def test_targets_come_row_by_row() -> None:
    rows = pl.DataFrame({"group": "main", "label": "FTL", "name": ["a", "b"], "rate": [0.1, 0.2]})
    limits = [Limit(words, pl.col("rate"), {"FTL": 0.1}) for words in ("x", "y")]
    assert Limits("main", limits).targets(rows)["name"].to_list() == ["a x", "a y", "b x", "b y"]
    assert len(Limits("hard", limits).targets(rows)) == 0


def test_bands_are_means_and_ranges_by_iteration() -> None:
    frame = frame_of([result(*curve("success_rate", values), seed=values[0]) for values in ([0, 1], [1, 3])])
    figure, axis = plt.subplots()
    draw_band(axis, frame, "success_rate", "SR")
    draw_band(axis, frame, "no such metric", "none")
    (line,) = axis.lines
    assert (list(line.get_xdata()), list(line.get_ydata())) == ([0, 1], [0.5, 2.0])
    assert axis.collections[0].get_datalim(axis.transData).bounds == (0, 0, 1, 3)
    plt.close(figure)


def test_actors_are_dashed_and_of_the_colour_of_their_case() -> None:
    both = result(*curve("success_rate", [0.1, 0.2]), *curve("actor_success_rate", [0.3]))
    figure = rates_figure(frame_of([both]), "label", {})
    parameters, actor = figure.axes[0].lines
    assert [line.get_label() for line in (parameters, actor)] == ["MA-BIRDS", "MA-BIRDS, actor"]
    assert (actor.get_linestyle(), actor.get_color()) == ("--", parameters.get_color())
    plt.close(figure)


def test_the_reports_show_the_tables(tmp_path: Path) -> None:
    benchmark = Benchmark({}, MEASURES, [], [Limits("main", [Limit("rate", pl.lit(1), {"FTL": 1})])], ["numpy"])
    table = Section("Rates", ["", "SR"], [["a", "1"], ["b<", "2"]])
    targets = benchmark.targets(benchmark.rows(frame_of([])))
    page = Page("Bees & <birds>", "How to read it.", ["a.png"], [table], targets, {"flights": 7})
    content = write_report(benchmark, frame_of([]), tmp_path, "mabirds bench", page)
    assert content == json.loads((tmp_path / "summary.json").read_text(encoding="utf-8"))
    assert set(content) == {"command", "machine", "seeds", "results", "targets", "flights"}
    assert (tmp_path / "report.md").read_text(encoding="utf-8") == (
        "# Bees & <birds>\n\n`mabirds bench`; seeds []. How to read it.\n\n"
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


@pytest.mark.parametrize("module", ["cli", "bench.discrete.outcome", "bench.continuous.outcome"])
def test_the_processes_of_cases_do_not_load_what_makes_reports(module: str) -> None:
    program = f"import sys, mabirds_bringup.{module}\nprint({{'polars', 'matplotlib', 'jinja2'}} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout == "set()\n"
