"""``mabirds bench``: a study of the package on small experiments, and one of a user's own."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from mabirds_bringup.bench.frame import LEARNER, read_results
from mabirds_bringup.bench.study import load_study

MABIRDS = str(Path(sys.executable).with_name("mabirds"))
EXACT = {"algorithm": {"steps": {"alpha": 8.0, "beta": 4.0}, "expectation": "exact"}}

MakeExperiment = Callable[..., Path]


def bench(*arguments: object, cwd: Path) -> "subprocess.CompletedProcess[str]":
    command = [MABIRDS, "bench", *map(str, arguments)]
    return subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False)


def content_of(done: "subprocess.CompletedProcess[str]") -> dict[str, Any]:
    assert done.returncode == 0, done.stderr
    content: dict[str, Any] = json.loads(done.stdout)
    return content


def groups_of(content: dict[str, Any]) -> set[str]:
    return {row["group"] for row in content["results"]}


def test_the_discrete_study_writes_a_report(make_experiment: MakeExperiment, tmp_path: Path) -> None:
    file = make_experiment(change=EXACT)
    small = [text for name in ("main", "many_starts", "trio") for text in ("--experiment", f"{name}={file}")]
    options = ("--iterations", 3, "--seeds", 1, "--jobs", 2, "--out", "out", "--json")
    content = content_of(bench("discrete", *small, *options, cwd=tmp_path))
    out = tmp_path / "out"
    assert content == json.loads((out / "summary.json").read_text(encoding="utf-8"))
    assert content["seeds"] == [301]
    assert {"name", "value", "target", "met"} <= set(content["targets"][0])
    labels = [(case.group, case.label) for case in load_study("discrete").cases]
    assert {(row["group"], row["label"]) for row in content["results"]} == set(labels)
    assert all(row["iterations"] == 3 and row["peak_memory"] > 50 for row in content["results"])
    assert len(read_results(out).select(*LEARNER, "seed").unique()) == len(content["results"])
    pictures = {path.name for path in out.glob("*.png")}
    assert pictures == {
        "game_main.png",
        "game_many_starts.png",
        "game_trio.png",
        "learned_main.png",
        "thresholds_main.png",
        "rates_main.png",
        "learned_optimal.png",
        "rates_optimal.png",
        "effort_tolerances.png",
        "rates_many_starts.png",
        "rates_trio.png",
        "rates_variations.png",
    }
    assert (out / "report.html").read_text(encoding="utf-8").count("<img") == len(pictures)
    report = (out / "report.md").read_text(encoding="utf-8")
    assert report.count("\n## ") == 8
    assert "| ME-greedy |" in report


def test_the_continuous_study_shows_what_obstacles_cost(make_drone_experiment: MakeExperiment, tmp_path: Path) -> None:
    main, actor_critic = (make_drone_experiment(planner, name=planner) for planner in ("lattice", "soft_actor_critic"))
    small = ("--experiment", f"main={main}", "--experiment", f"soft_actor_critic={actor_critic}", "--iterations", 2)
    options = ("--seeds", 1, "--rollouts", 40, "--only", "soft_actor_critic", "--out", "out", "--json")
    content = content_of(bench("continuous", *small, *options, cwd=tmp_path))
    assert content["rollouts"] == 40
    assert {"cores", "threads", "python", "numpy", "scipy", "torch"} == set(content["machine"])
    measures = {"actor_success_rate", "obstacle_dearer", "closeness_dearer"}
    assert all(measures <= {name for name, value in row.items() if value is not None} for row in content["results"])
    report = (tmp_path / "out" / "report.md").read_text(encoding="utf-8")
    assert "(continuous actions)" in report
    assert "| (1.5, 1.5) m, drone 1 |" in report
    assert {path.name for path in (tmp_path / "out").glob("*soft_actor_critic.png")} == {
        f"{kind}_soft_actor_critic.png" for kind in ("game", "learned", "rates", "consensus")
    }


@pytest.fixture
def study(make_experiment: MakeExperiment, tmp_path: Path) -> Path:
    """Two groups of a user's own."""
    content = {
        "title": "Mine",
        "note": "Two groups.",
        "experiments": {"main": str(make_experiment(change=EXACT))},
        "groups": {
            "first": {"title": "As it is", "cases": [{"label": "MA-BIRDS"}, {"label": "central", "method": "bics"}]},
            "second": {
                "title": "With a window",
                "pictures": ["consensus"],
                "cases": [{"label": "window", "changes": {"algorithm": {"window": 2}}}],
            },
        },
        "columns": {"SR": "success_rate"},
        "targets": [{"measure": "success_rate", "groups": ["first"], "at_least": {"MA-BIRDS": 0.0, "central": 2.0}}],
    }
    file = tmp_path / "mine.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


def test_a_study_of_ones_own_is_run_group_by_group(study: Path, tmp_path: Path) -> None:
    options = ("--seeds", 2, "--first-seed", 7, "--json")
    first = content_of(bench("mine.yaml", *options, "--iterations", 2, "--only", "second", cwd=tmp_path))
    assert (groups_of(first), first["seeds"], first["targets"]) == ({"second"}, [7, 8], [])
    both = content_of(bench(study, *options, "--iterations", 3, "--only", "first", cwd=tmp_path))
    assert {row["group"]: row["iterations"] for row in both["results"]} == {"second": 2, "first": 3}
    met = {target["name"]: target["met"] for target in both["targets"]}
    assert met == {
        "first: MA-BIRDS learner_1 success_rate": True,
        "first: MA-BIRDS learner_2 success_rate": True,
        "first: central success_rate": False,
    }
    assert (tmp_path / "runs" / "bench-mine" / "consensus_second.png").exists()


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("discreet",), "give a study's file, or one of continuous, costs, discrete"),
        (("discrete", "--experiment", "main=nowhere.yaml"), "nowhere.yaml"),
        (("discrete", "--experiment", "nowhere.yaml"), "expected NAME=FILE"),
        (("discrete", "--only", "hard"), "the study has the groups"),
    ],
)
def test_the_command_refuses_what_there_is_not(arguments: tuple[str, ...], words: str, tmp_path: Path) -> None:
    done = bench(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert words in " ".join(done.stderr.split())
