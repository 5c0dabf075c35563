"""A game with a reward, a planner and a method from three packages that the repository does not know."""

import csv
import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml

MABIRDS = ("-c", "from mabirds_bringup.cli import main; main()")
EXPERIMENT = Path(__file__).resolve().parents[2] / "examples" / "junction" / "experiment.yaml"


@pytest.fixture
def experiment(tmp_path: Path, run: Any) -> Path:
    """The junction with few iterations, its planner and reward from outside, and its bag."""
    content = yaml.safe_load(EXPERIMENT.read_text(encoding="utf-8"))
    content["iterations"] = content["demonstrations"]["per_learner"] = 6
    content["algorithm"]["policy"] = {"kind": "tempered", "temperature": 0.5}
    content["algorithm"]["reward"] = {"kind": "progress"}
    content["baselines"] = {"untouched": {"penalty": 4.0}}
    file = tmp_path / "experiment.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    run(*MABIRDS, "record", str(file))
    return file


def metrics(directory: Path) -> list[dict[str, str]]:
    (file,) = directory.glob("2*/metrics.csv")
    with file.open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def test_kinds_lists_what_strangers_bring_and_which_package_brings_it(run: Any) -> None:
    listed = {(kind["group"], kind["name"]): kind for kind in json.loads(run(*MABIRDS, "kinds", "--json"))["kinds"]}
    for group, name, package in (
        ("games", "junction", "mabirds_junction"),
        ("rewards", "progress", "mabirds_junction"),
        ("planners", "tempered", "mabirds_tempered"),
        ("methods", "untouched", "mabirds_untouched"),
        ("cost features", "in_sight", "mabirds_sight"),
        ("games", "patrol", "mabirds_core"),
        ("mixers", "resilient", "mabirds_core"),
    ):
        assert listed[group, name]["package"].replace("-", "_") == package
        assert listed[group, name]["problem"] == ""


def test_they_run_as_processes_and_give_the_loops_table(run: Any, experiment: Path, tmp_path: Path) -> None:
    run(*MABIRDS, "bag", "check", str(experiment))
    run(*MABIRDS, "simulate", str(experiment), "--out", "alone")
    run(*MABIRDS, "run", str(experiment), "--rate", "100", "--out", "network")
    assert metrics(tmp_path / "network") == metrics(tmp_path / "alone")
    (directory,) = (tmp_path / "network").glob("2*")
    assert "junction" in (directory / "report.html").read_text(encoding="utf-8")
    assert (directory / "map.png").read_bytes().startswith(b"\x89PNG")


def test_the_method_runs_as_a_node_and_learns_what_nobody_touches(run: Any, experiment: Path, tmp_path: Path) -> None:
    run(*MABIRDS, "run", str(experiment), "--method", "untouched", "--rate", "100", "--out", "network")
    run(*MABIRDS, "simulate", str(experiment), "--method", "untouched", "--out", "alone")
    assert metrics(tmp_path / "network") == metrics(tmp_path / "alone")
    (file,) = (tmp_path / "network").glob("2*/summary.json")
    summary = json.loads(file.read_text(encoding="utf-8"))["learners"]["untouched"]
    assert "meeting in the junction" in summary["learned_constraints"]
    assert summary["false_negative_rate"] == 0.0


def test_a_study_of_a_strangers_game_is_run(run: Any, experiment: Path, tmp_path: Path) -> None:
    study = EXPERIMENT.with_name("study.yaml")
    options = ("--experiment", f"main={experiment}", "--seeds", "1", "--out", "out", "--json")
    content = json.loads(run(*MABIRDS, "bench", str(study), *options))
    learners = {(row["label"], row["learner"]) for row in content["results"] if row["group"] == "main"}
    assert learners == {("MA-BIRDS", "north"), ("MA-BIRDS", "east"), ("BICS", "bics"), ("untouched", "untouched")}
    assert [target["name"] for target in content["targets"]] == [
        f"main: MA-BIRDS {learner} success_rate" for learner in ("north", "east")
    ]
    assert {path.name for path in (tmp_path / "out").glob("*.png")} == {
        "learned_main.png",
        "rates_main.png",
        "rates_variations.png",
        "consensus_variations.png",
    }


CONFORMANCE = """
import numpy as np
from pathlib import Path
from mabirds_core import conformance
from mabirds_core.experiment.assembly import build_game, build_method, build_reward
from mabirds_core.experiment.file import load_experiment
from mabirds_core.registry import build, kinds

experiment = load_experiment(Path({file!r}))
game = build_game(experiment)
conformance.check_settings(kinds("mabirds.games")["junction"], experiment.game.model_dump())
conformance.check_game(game)
reward = build_reward(experiment, game)
conformance.check_reward(reward, game)
conformance.check_planner(build("mabirds.planners", experiment.algorithm.policy, game, reward), game, reward)
conformance.check_method(build_method(experiment, "untouched", game), game)
print(type(game).__name__, type(reward).__name__)
"""


def test_all_of_them_conform(run: Any, experiment: Path) -> None:
    assert run("-c", CONFORMANCE.format(file=str(experiment))) == "JunctionGame ProgressReward\n"


def test_without_the_package_its_kind_is_refused_with_what_there_is(run: Any, tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(EXPERIMENT.read_text(encoding="utf-8").replace("kind: junction", "kind: roundabout"))
    words = run(*MABIRDS, "simulate", str(file), code=2)
    assert "game: " in words
    assert "'roundabout'" in words
    assert "`mabirds kinds`" in " ".join(words.split())


def test_settings_of_strangers_are_as_strict_as_ours(run: Any, tmp_path: Path) -> None:
    file = tmp_path / "experiment.yaml"
    file.write_text(EXPERIMENT.read_text(encoding="utf-8").replace("horizon: 8", 'horizon: "8"'))
    assert "game.horizon: " in run(*MABIRDS, "simulate", str(file), code=2)


LEARNER = "from mabirds_learner.learner_node import main; raise SystemExit(main())"


def test_a_learner_of_a_strangers_game_can_be_inspected(
    run: Any, environment: dict[str, str], experiment: Path
) -> None:
    arguments = ("--ros-args", "-r", "__ns:=/north", "-p", f"experiment:={experiment}")
    with subprocess.Popen([sys.executable, "-c", LEARNER, *arguments], env=environment) as learner:
        try:
            shown = run(*MABIRDS, "inspect", "--once", "--json", "--timeout", "20")
        finally:
            learner.terminate()
    assert "north" in shown


SIGHT = EXPERIMENT.parents[1] / "sight" / "experiment.yaml"

SIGHT_CONFORMS = """
import numpy as np
from pathlib import Path
from mabirds_core import conformance
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.games.patrol.named_costs import joint_places
from mabirds_core.registry import kinds

experiment = load_experiment(Path({file!r}))
game = build_game(experiment)
places, kind = joint_places(game.grid, {{}}), kinds("mabirds.cost_features")["in_sight"]
conformance.check_cost_feature(kind, experiment.game.costs["seen"].model_dump(), places, game.n_states)
conformance.check_game(game)

rng, walls = np.random.default_rng(0), {{(r, c) for r in (1, 2) for c in (2, 3, 4)}}
seen = kind.build(experiment.game.costs["seen"], places)
for state in rng.integers(game.n_states, size=400):
    one, other = (np.array(divmod(int(cell), game.width), dtype=float) for cell in game.cells(state))
    line = one + np.linspace(0, 1, 4001)[:, None] * (other - one)
    inside = any((np.abs(line - wall) < 0.4999).all(axis=1).any() for wall in walls)
    touched = any((np.abs(line - wall) < 0.5001).all(axis=1).any() for wall in walls)
    visible = np.hypot(*(other - one)) <= 6
    if inside == touched:  # else the line passes a corner
        assert seen[state] == (visible and not inside), (one, other)
print(game.cost_features.names[-2:], seen.mean() > 0.2)
"""


def test_a_cost_feature_from_outside_conforms_and_is_what_it_says(run: Any) -> None:
    """Line by line, by points on it."""
    assert run("-c", SIGHT_CONFORMS.format(file=str(SIGHT))) == "('seen', 'near') True\n"


def test_a_cost_feature_from_outside_is_learned_through_nodes(run: Any, tmp_path: Path) -> None:
    content = yaml.safe_load(SIGHT.read_text(encoding="utf-8"))
    content["iterations"] = content["demonstrations"]["per_learner"] = 6
    file = tmp_path / "sight.yaml"
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    run(*MABIRDS, "record", str(file))
    run(*MABIRDS, "simulate", str(file), "--out", "alone")
    run(*MABIRDS, "run", str(file), "--rate", "100", "--out", "network")
    assert metrics(tmp_path / "network") == metrics(tmp_path / "alone")


def test_settings_of_a_cost_feature_from_outside_are_checked(run: Any, tmp_path: Path) -> None:
    text, file = SIGHT.read_text(encoding="utf-8"), tmp_path / "experiment.yaml"
    file.write_text(text.replace("reach: 6.0", "reach: -1"), encoding="utf-8")
    words = " ".join(run(*MABIRDS, "simulate", str(file), code=2).split())
    assert "costs.seen.in_sight.reach" in words
    file.write_text(text.replace("kind: in_sight", "kind: out_of_sight"), encoding="utf-8")
    words = " ".join(run(*MABIRDS, "simulate", str(file), code=2).split())
    assert "'out_of_sight'" in words
    assert "`mabirds kinds`" in words
