"""One experiment started in two halves, each on a host of its own."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from halves import HALVES, Halves, settings, two_halves
from namespaces import obstacle

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate_with_progress
from mabirds_bringup.evaluate.evaluation import evaluate, summary
from mabirds_bringup.run.network import Network
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.environment import FASTDDS_PROFILE

OBSTACLE = obstacle()
on_hosts = pytest.mark.skipif(OBSTACLE is not None, reason=f"no network namespaces: {OBSTACLE}")


@pytest.fixture
def halves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Halves]:
    monkeypatch.setenv("FASTRTPS_DEFAULT_PROFILES_FILE", str(FASTDDS_PROFILE))  # other tests keep to this host
    with two_halves(tmp_path) as made:
        yield made


@on_hosts
def test_two_halves_complete_and_agree(make_experiment: Callable[..., Path], tmp_path: Path, halves: Halves) -> None:
    """The left host has no bag, as it has no player: theta says what was shown, so that it tests constraints, too."""
    files = {"right": make_experiment(**settings()), "left": tmp_path / "without_bag.yaml"}
    content = yaml.safe_load(files["right"].read_text(encoding="utf-8"))
    content["demonstrations"]["bag"] = "nowhere"
    files["left"].write_text(yaml.safe_dump(content), encoding="utf-8")
    for host, file in files.items():
        halves.start_part(host, file)
    experiment = load_experiment(files["right"])
    streams = demonstrations_of(experiment)
    history = simulate_with_progress(experiment, streams, None)
    for host in HALVES:
        assert halves.end(host) == 0, halves.explained(f"{host} failed")
        found = json.loads((tmp_path / host / "latest" / "summary.json").read_text(encoding="utf-8"))
        expected = summary(experiment, evaluate(experiment, history, streams if host == "right" else {}), 0.0)
        assert found["complete"]
        assert {name: found[name] for name in expected} | {"wall_seconds": 0.0} == expected
        assert "test at confidence" in found["constraint_rule"]
        logs = {log.stem for log in (tmp_path / host / "latest" / "logs").glob("*.log")}
        assert logs == set(HALVES[host])


@on_hosts
def test_halves_of_different_experiments_refuse_and_name_the_setting(
    make_experiment: Callable[..., Path], halves: Halves
) -> None:
    file = make_experiment(**settings())
    other = file.with_name("other.yaml")
    other.write_text(yaml.safe_dump({**yaml.safe_load(file.read_text(encoding="utf-8")), "seed": 4}), encoding="utf-8")
    digests = [load_experiment(one).run_digest("monday") for one in (file, other)]
    halves.start_part("left", file)
    halves.start_part("right", other)
    for host in HALVES:
        assert halves.end(host) == 2
        output = halves.said(host)
        assert all(digest in output for digest in digests), output
        assert "start all hosts with the same experiment file and the same --run" in output
    assert "seed is 4 there and 3 here" in halves.said("left")
    assert "seed is 3 there and 4 here" in halves.said("right")


@on_hosts
def test_halves_that_are_killed_at_the_end_still_hear_all(make_experiment: Callable[..., Path], halves: Halves) -> None:
    """A half that has everything is there for the other; killed, it is there again by the same command."""
    file = make_experiment(**settings())
    for host in HALVES:
        halves.start_part(host, file)
    halves.wait(lambda: any("all is here" in halves.said(host) for host in HALVES))
    halves.stop()
    halves.start_part("right", file)
    halves.wait(lambda: "going on with" in halves.said("right"))
    halves.start_part("left", file)
    halves.assert_all_whole(file)


def test_a_node_that_the_experiment_does_not_have_is_refused(
    make_experiment: Callable[..., Path], tmp_path: Path
) -> None:
    file = make_experiment()
    with pytest.raises(
        ExperimentError, match="--only learner_9: expected some of .'learner_1', 'learner_2', 'expert_player'"
    ):
        Network(load_experiment(file), file, tmp_path, {}, only=["learner_9"])
