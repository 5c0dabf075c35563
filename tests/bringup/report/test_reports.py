"""Reports of runs: one file, in words, with every number explained; several runs side by side."""

import json
import re
from collections.abc import Callable
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
import yaml
from mabirds_msgs.msg import LearnerStatus

from mabirds_bringup.commands.report import report
from mabirds_bringup.commands.simulate import simulate
from mabirds_bringup.report.comparison import UnjudgedRunError, differences, load_judged
from mabirds_bringup.report.findings import findings
from mabirds_bringup.report.measures import MEASURES
from mabirds_bringup.report.page import constraints, manifest, write_report
from mabirds_bringup.report.traffic import traffic
from mabirds_msgs_py.bag_writer import BagWriter

MakeExperiment = Callable[..., Path]


@pytest.fixture(scope="module")
def runs(make_shared_experiment: MakeExperiment, tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Two simulated runs, of which the second has learned less."""
    out = tmp_path_factory.mktemp("runs")
    directories = []
    for name, iterations in (("long", 8), ("short", 3)):
        simulate(make_shared_experiment(iterations=iterations, name=name), out=out)
        directories.append((out / "latest").resolve())
    return directories


class Outside(HTMLParser):
    """What a page would load or link to."""

    def __init__(self) -> None:
        super().__init__()
        self.loaded, self.linked = list[str](), list[str]()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        self.loaded += [str(given[name]) for name in ("src", "srcset") if name in given]
        if "href" in given:
            (self.linked if tag == "a" else self.loaded).append(str(given["href"]))


def outside(page: str) -> Outside:
    parser = Outside()
    parser.feed(page)
    return parser


def test_a_report_is_one_file_that_explains_every_rate(runs: list[Path]) -> None:
    page = (runs[0] / "report.html").read_text(encoding="utf-8")
    found = outside(page)
    assert len(found.loaded) == 3
    assert all(source.startswith("data:image/png;base64,") for source in found.loaded)
    assert {"manifest.json", "metrics.csv", "logs"} <= set(found.linked)
    assert all((runs[0] / link).exists() for link in found.linked)
    assert 'name="viewport"' in page
    summary = json.loads((runs[0] / "summary.json").read_text(encoding="utf-8"))
    for measure in MEASURES:
        assert f"<dt>{measure.title}</dt><dd>" in page
        assert measure.key in summary["learners"]["learner_1"]
    for text in ("commit", "iterations: 8", "Settings", *findings(summary)):
        assert text in page
    for constraint in summary["learners"]["learner_1"]["learned_constraints"]:
        assert constraint in page


def test_the_markdown_says_the_same(runs: list[Path]) -> None:
    text = (runs[0] / "report.md").read_text(encoding="utf-8")
    pictures = re.findall(r"!\[[^\]]+\]\(([^)]+)\)", text)
    assert pictures == ["map.png", "curves.png", "schedule.png"]
    assert all((runs[0] / picture).is_file() for picture in pictures)
    table = [line for line in text.splitlines() if line.startswith("| learner_")]
    assert len(table) == 2
    assert len({line.count("|") for line in table}) == 1
    assert table[0].count("|") == 3 + len(MEASURES)


def test_constraints_are_a_table_by_name_and_learner() -> None:
    first, second = {"wall": 0.9, "swap": 0.6}, {"swap": 0.95, "door": None}
    summary = summary_of({"learned_constraints": first}, {"learned_constraints": second})
    assert constraints(summary) == [["swap", "0.600", "0.950"], ["wall", "0.900", ""], ["door", "", "yes"]]


def test_a_map_in_the_settings_looks_like_one(tmp_path: Path) -> None:
    content = {"settings": {"map": "##\n#.\n", "name": "one: two"}}
    (tmp_path / "manifest.json").write_text(json.dumps(content), encoding="utf-8")
    text = manifest(tmp_path)["settings_text"]
    assert text == "map: |\n  ##\n  #.\nname: 'one: two'\n"
    assert yaml.safe_load(text) == content["settings"]


def test_several_runs_are_compared(runs: list[Path], tmp_path: Path) -> None:
    assert report(runs, out=tmp_path / "comparison") == 0
    page = (tmp_path / "comparison" / "report.html").read_text(encoding="utf-8")
    assert all(source.startswith("data:image/png") for source in outside(page).loaded)
    assert page.count("<td>learner_1</td>") == page.count("<td>learner_2</td>") == 2
    long, short = map(load_judged, runs)
    assert ["iterations", "8", "3"] in differences([long, short])
    assert all(line[0] not in {"game.horizon", "learners"} for line in differences([long, short]))
    assert differences([long, long]) == []
    assert len(long.success) == 9
    text = (tmp_path / "comparison" / "report.md").read_text(encoding="utf-8")
    assert "| iterations | 8 | 3 |" in text


def test_a_run_without_rates_cannot_be_compared(runs: list[Path], tmp_path: Path) -> None:
    with pytest.raises(UnjudgedRunError, match=r"no summary.json; run `mabirds report"):
        report([runs[0], tmp_path])


ROW = {
    "iterations": 5,
    "success_rate": 0.5,
    "violation_rate": 0.25,
    "success_late_minimum": 0.5,
    "held_out_log_likelihood": None,
    "false_discovery_rate": 0.0,
    "false_negative_rate": 1.0,
    "learned_constraints": {},
    "undetermined": None,
}


def summary_of(*rows: dict[str, Any], **more: Any) -> dict[str, Any]:
    learners = {f"learner_{number}": {**ROW, **row} for number, row in enumerate(rows)}
    distances = {"theta": 1.0, "omega": 0.0, "policy": 0.25}
    return {"learners": learners, "expert_log_likelihood": None, "consensus_distance": distances, **more}


def test_findings_name_ranges_and_leave_out_what_is_not_known() -> None:
    words = " ".join(findings(summary_of({}, {"success_rate": 0.9, "iterations": 6})))
    assert "Each of 2 learners watched 5 to 6 demonstrations" in words
    assert "in 50.0 to 90.0 % of trials" in words
    assert "differs in at most 25.0 % of the time" in words
    assert "nats" not in words
    assert "cannot tell" not in words
    alone = " ".join(findings(summary_of({"success_late_minimum": 0.1})))
    assert "The learner watched 5" in alone
    assert "success fell to 10.0 %" in alone
    assert "differs" not in alone


@pytest.mark.parametrize(
    ("delivered", "words"),
    [
        ({"iterations": 7, "edge_mismatches": []}, "delivered what the schedule asked for, in all 7 iterations"),
        ({"iterations": 7, "edge_mismatches": ["one", "two"]}, "differed from its schedule 2 times"),
        ({"iterations": 7, "late": 3}, "differed from its schedule 3 times"),
    ],
)
def test_findings_say_what_was_delivered(delivered: dict[str, Any], words: str) -> None:
    assert words in findings(summary_of({}, delivered_graph=delivered))[-1]


def test_traffic_is_that_of_all_bags(tmp_path: Path) -> None:
    assert traffic(tmp_path) is None
    for name, count in (("bag", 3), ("bag_2", 2)):
        with BagWriter(tmp_path / name) as bag:
            for stamp in range(count):
                bag.write("/learner_1/status", LearnerStatus(metric_values=[0.0]), stamp)
    found = traffic(tmp_path)
    assert found is not None
    assert found.messages == {"/learner_1/status": 5}
    assert 0.001 < found.megabytes < 0.1


@pytest.mark.parametrize(
    "delivered", [{"late": 3}, {"edge_mismatches": ["iteration 2: b -> c not delivered"]}], ids=str
)
def test_a_report_is_written_of_either_mode(runs: list[Path], tmp_path: Path, delivered: dict[str, Any]) -> None:
    """What is late in resilient mode is no mismatch, and has no list."""
    summary = json.loads((runs[0] / "summary.json").read_text(encoding="utf-8"))
    graph = {"iterations": 8, "connectivity_window": 2, **delivered}
    (tmp_path / "manifest.json").write_bytes((runs[0] / "manifest.json").read_bytes())
    (tmp_path / "experiment.yaml").write_bytes((runs[0] / "experiment.yaml").read_bytes())
    write_report(tmp_path, {**summary, "delivered_graph": graph}, {})
    for name in ("report.html", "report.md"):
        page = (tmp_path / name).read_text(encoding="utf-8")
        assert ("not delivered" in page) == ("edge_mismatches" in delivered)
        assert "differed from its schedule" in page
