"""One experiment started in two halves, each on a host of its own."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
import yaml
from namespaces import VirtualLan, obstacle, virtual_lan

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate_with_progress
from mabirds_bringup.evaluate.evaluation import evaluate, summary
from mabirds_bringup.run.network import Network
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.environment import FASTDDS_PROFILE

OBSTACLE = obstacle()
on_hosts = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")
MABIRDS = str(Path(sys.executable).with_name("mabirds"))
HALVES = {"left": ["learner_1", "learner_2"], "right": ["learner_3", "expert_player"]}

Run = Callable[[str, Path], "subprocess.Popen[str]"]


@pytest.fixture
def run_half(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Run]:
    """A function that starts the half of a host with an experiment file; what is left at the end is killed."""
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(FASTDDS_PROFILE))  # other tests keep to this host
    started: list[subprocess.Popen[str]] = []

    def run(lan: VirtualLan, host: str, file: Path) -> "subprocess.Popen[str]":
        only = [part for name in HALVES[host] for part in ("--only", name)]
        command = [MABIRDS, "run", str(file), "--hz", "20", "--run", "monday", "--out", str(tmp_path / host), *only]
        command = lan.inside(host, command)
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True))
        return started[-1]

    with virtual_lan(list(HALVES)) as lan:
        yield lambda host, file: run(lan, host, file)
        for process in started:
            process.terminate()
        for process in started:
            process.communicate(timeout=20)


def settings() -> dict[str, Any]:
    return {"learners": 3, "iterations": 10, "schedule": {"kind": "directed_ring"}}


@on_hosts
def test_two_halves_complete_and_agree(make_experiment: Callable[..., Path], tmp_path: Path, run_half: Run) -> None:
    """The left host has no bag, as it has no player: it cannot test constraints and tells them by the threshold."""
    files = {"right": make_experiment(**settings()), "left": tmp_path / "without_bag.yaml"}
    content = yaml.safe_load(files["right"].read_text(encoding="utf-8"))
    content["demonstrations"]["bag"] = "nowhere"
    files["left"].write_text(yaml.safe_dump(content), encoding="utf-8")
    halves = {host: run_half(host, files[host]) for host in HALVES}
    experiment = load_experiment(files["right"])
    streams = demonstrations_of(experiment)
    history = simulate_with_progress(experiment, streams, None)
    for host, process in halves.items():
        output, _ = process.communicate(timeout=60)
        assert process.returncode == 0, output
        found = json.loads((tmp_path / host / "latest" / "summary.json").read_text(encoding="utf-8"))
        expected = summary(experiment, evaluate(experiment, history, streams if host == "right" else {}), 0.0)
        assert found["complete"]
        assert {name: found[name] for name in expected} | {"wall_seconds": 0.0} == expected
        assert ("test at confidence" in found["constraint_rule"]) == (host == "right")
        logs = {log.stem for log in (tmp_path / host / "latest" / "logs").glob("*.log")}
        assert logs == set(HALVES[host])


@on_hosts
def test_halves_of_different_experiments_refuse_with_both_digests(
    make_experiment: Callable[..., Path], run_half: Run
) -> None:
    file = make_experiment(**settings())
    other = file.with_name("other.yaml")
    other.write_text(yaml.safe_dump({**yaml.safe_load(file.read_text(encoding="utf-8")), "seed": 4}), encoding="utf-8")
    digests = [load_experiment(one).run_digest("monday") for one in (file, other)]
    for process in [run_half("left", file), run_half("right", other)]:
        output, _ = process.communicate(timeout=60)
        assert process.returncode == 2, output
        assert all(digest in output for digest in digests), output
        assert "start all hosts with the same experiment file and the same --run" in output


def test_a_node_that_the_experiment_does_not_have_is_refused(
    make_experiment: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_experiment()
    with pytest.raises(
        ExperimentError, match="--only learner_9: expected some of .'learner_1', 'learner_2', 'expert_player'"
    ):
        Network(load_experiment(file), file, tmp_path, {}, only=["learner_9"])
