"""``mabirds tune``: what is tried, how demonstrations are cut, and what is written."""

import json
from pathlib import Path

import numpy as np
import pytest
from typer.main import get_command

from mabirds_bringup.application import app
from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.tuning.choices import changed, drawn, tried
from mabirds_bringup.tuning.search import Trial, folds_of, settings_of, tried_out
from mabirds_core.algorithm.memory import stacked
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_game, evaluation_policy
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import Streams, simulate
from mabirds_core.metrics.likelihood import log_likelihoods

PATROL = Path(__file__).resolve().parents[3] / "ros_ws" / "config" / "patrol.yaml"


@pytest.fixture(scope="module")
def experiment() -> Experiment:
    return load_experiment(PATROL).model_copy(update={"iterations": 8})


@pytest.fixture(scope="module")
def streams(experiment: Experiment) -> Streams:
    return {name: stream[:8] for name, stream in demonstrations_of(experiment).items()}


def test_values_are_those_of_yaml() -> None:
    assert tried("a.b=1,2.5,all,true").values == (1, 2.5, "all", True)
    assert [tried("a=x,y,z").at(share) for share in (0.0, 0.34, 0.99)] == ["x", "y", "z"]
    assert [tried("a=0.01..100").at(share) for share in (0.0, 0.5, 0.75)] == pytest.approx([0.01, 1.0, 10.0])


@pytest.mark.parametrize("text", ["a", "a=", "=3", "a=0..3", "a=3..1", "a=x..y", "a=1..2..3"])
def test_what_says_nothing_to_try_is_refused(text: str) -> None:
    with pytest.raises(ExperimentError, match="expected PATH=VALUE"):
        tried(text)


def test_few_combinations_are_all_tried_and_many_are_drawn() -> None:
    few = drawn([tried("a=1,2"), tried("b=x,y")], 5, seed=0)
    assert few == [{}, {"a": 1, "b": "x"}, {"a": 1, "b": "y"}, {"a": 2, "b": "x"}, {"a": 2, "b": "y"}]
    many = drawn([tried("a=1..100"), tried("b=x,y")], 65, seed=0)
    assert many[0] == {}
    assert len(many) == 65
    assert sum(of["a"] < 10 for of in many[1:]) == pytest.approx(32, abs=2)  # half of the decades
    assert sum(of["b"] == "x" for of in many[1:]) == pytest.approx(32, abs=2)


def test_wrong_settings_and_other_games_are_refused(experiment: Experiment) -> None:
    with pytest.raises(ExperimentError, match=r"--try algorithm.windo=3: algorithm.windo"):
        changed(experiment, {"algorithm.windo": 3})
    with pytest.raises(ExperimentError, match="demonstrations are of another game"):
        changed(experiment, {"game.waiting": True})
    with pytest.raises(ExperimentError, match="name is no group of settings"):
        changed(experiment, {"name.first": 1})
    assert changed(experiment, {"game.discount": 0.9}).game.discount == 0.9


def test_every_demonstration_judges_once_and_copies_are_on_one_side(streams: Streams) -> None:
    repeated = {name: [*stream, *stream] for name, stream in streams.items()}
    judging = []
    for learning, left_out in folds_of(repeated, 3):
        shown = {one.states.tobytes() + one.actions.tobytes() for stream in learning.values() for one in stream}
        rows = [states.tobytes() + actions.tobytes() for states, actions in zip(*left_out, strict=True)]
        for name, stream in learning.items():
            own = {one.states.tobytes() + one.actions.tobytes() for one in streams[name]}
            assert len({*own} & shown) < len(own)
            assert len(stream) % 2 == 0
        judging += rows
    whole = {one.states.tobytes() + one.actions.tobytes() for stream in streams.values() for one in stream}
    assert set(judging) == whole
    with pytest.raises(ExperimentError, match="take fewer folds"):
        list(folds_of({"learner_1": streams["learner_1"][:1] * 5}, 2))


def test_scores_are_those_of_learning_by_hand(experiment: Experiment, streams: Streams) -> None:
    folds = list(folds_of(streams, 2))
    trial = tried_out(experiment, {"algorithm.window": 2}, folds)
    least = min(len(stream) for fold in folds for stream in fold.learning.values())
    by_hand = experiment.model_copy(
        update={"iterations": least, "algorithm": experiment.algorithm.model_copy(update={"window": 2})}
    )
    game, scores = build_game(by_hand), []
    for fold in folds:
        for name, parameters in simulate(by_hand, fold.learning).items():
            policy = evaluation_policy(by_hand, name, game)(parameters[least])
            scores.append(log_likelihoods(game, policy, stacked([fold.judging])).mean())
    assert trial.stops[-1] == least
    assert trial.scores[-1] == pytest.approx(np.mean(scores))


def test_fewer_iterations_are_written_where_they_are_better(experiment: Experiment) -> None:
    early = Trial({"a": 1}, np.array([2, 4, 6]), np.array([-3.0, -1.0, -2.0]))
    late = Trial({}, np.array([2, 4, 6]), np.array([-3.0, -2.0, -1.0]))
    assert settings_of(early, experiment) == {"a": 1, "iterations": 4}
    assert settings_of(late, experiment) == {"iterations": experiment.iterations}


def test_the_command_writes_an_experiment_that_can_be_learned(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "tuned" / "patrol.yaml"
    words = ["tune", PATROL, "--try", "algorithm.window=1,all", "--folds", "2", "--out", out, "--json"]
    get_command(app)([*map(str, words)], standalone_mode=False)
    told = json.loads(capfd.readouterr().out)
    assert [trial["changes"] for trial in told["trials"]] == [{}, {"algorithm.window": 1}, {"algorithm.window": "all"}]
    assert told["trials"][0]["nats"] == told["trials"][2]["nats"] > told["trials"][1]["nats"]
    tuned, before = load_experiment(out), load_experiment(PATROL)
    assert tuned.demonstrations.bag == before.demonstrations.bag
    assert tuned.iterations == told["chosen"]["iterations"]
    assert tuned.game == before.game
