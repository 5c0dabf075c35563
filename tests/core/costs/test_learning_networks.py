"""Learners whose costs are a network: from the file to policies, constraints and checkpoints."""

from typing import Any

import numpy as np
import pytest
from arenas import drone_experiment
from experiments import changed, demonstrations, experiment

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.storage import from_arrays, to_arrays
from mabirds_core.costs.models import costs_of
from mabirds_core.errors import CheckpointError, ExperimentError
from mabirds_core.experiment.assembly import build_game, build_learner, build_method, evaluation_policy
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.names import parameter_names
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.whole_game import Learned
from mabirds_core.metrics.metrics import exact_imitation

NETWORK = {"kind": "network", "width": 4, "bound": 8.0, "apart": 1.0}


def with_network(**changes: Any) -> Experiment:
    defaults = {"kind": "adaptive"}
    algorithm = {"steps": defaults, "window": "all", "expectation": "exact", "rollout_start": "demonstration"}
    content = {f"algorithm.{name}": value for name, value in (algorithm | {"cost": NETWORK}).items()}
    return experiment({**content, "game.horizon": 8, **changes})


def test_they_begin_alike_and_learn_what_experts_do_not_do() -> None:
    settings = with_network(**{"iterations": 30, "demonstrations.per_learner": 30})
    game, (ann, bob) = build_game(settings), (build_learner(settings, name) for name in ("ann", "bob"))
    first, other = ann.initial_state().parameters, bob.initial_state().parameters
    assert first.omega.any()
    np.testing.assert_array_equal(first.omega, other.omega)
    history = simulate(settings, demonstrations(settings))["ann"]
    policy = evaluation_policy(settings, "ann", game)
    rates = [exact_imitation(game, policy(history[n])).violation_rate for n in (0, -1)]
    assert rates[0] > 0.9
    assert rates[1] < 0.1


def test_learners_come_together_in_omega() -> None:
    settings = with_network(iterations=12)
    history = simulate(settings, demonstrations(settings))
    final = np.array([history[name][-1].omega for name in settings.learners])
    assert np.abs(final - final.mean(axis=0)).max() < np.abs(final - history["ann"][0].omega).max() / 2


def alone() -> Experiment:
    return with_network(learners=["ann"])


def advanced(learner: Learner, state: LearnerState, shown: list[Any], until: int) -> LearnerState:
    while state.iteration <= until:
        state = learner.step(state, shown[state.iteration - 1], {}).state
    return state


def test_they_go_on_from_their_checkpoints_bit_for_bit() -> None:
    settings = alone()
    shown, learner = demonstrations(settings)["ann"], build_learner(settings, "ann")
    whole = advanced(learner, learner.initial_state(), shown, 6)
    half = to_arrays(learner, advanced(learner, learner.initial_state(), shown, 3))
    again = build_learner(settings, "ann")
    resumed = advanced(again, from_arrays(again, 4, half), shown, 6)
    for found, expected in zip(resumed.parameters, whole.parameters, strict=True):
        assert found.tobytes() == expected.tobytes()
    with pytest.raises(CheckpointError, match=r"observed\.cost"):
        from_arrays(again, 4, {**half, "observed.cost": half["observed.cost"][:-1]})


def test_constraints_are_told_by_what_a_network_costs() -> None:
    """Sharing a cell is a constraint though omega has no number of its own for it; what was shown is none."""
    settings = alone()
    shown, learner, game = demonstrations(settings)["ann"], build_learner(settings, "ann"), build_game(settings)
    state = advanced(learner, learner.initial_state(), shown, 12)
    features = learner.shown(state)
    assert features is not None
    confidences = game.judge.constraint_confidences(learner.estimator.reward, state.parameters, features)
    assert confidences is not None
    named = dict(zip(game.cost_features.names, confidences, strict=True))
    assert named["expert_1 in (0, 0)"] == -1
    assert named["expert_1 in (1, 1)"] > 0.5


def test_a_file_that_says_linear_is_the_one_that_says_nothing() -> None:
    plain = experiment()
    assert experiment({"algorithm.cost": {"kind": "linear"}}).digest == plain.digest
    assert experiment({"algorithm.cost": NETWORK}).digest != plain.digest
    assert costs_of(build_game(plain)).linear


def test_weights_of_a_network_have_no_names() -> None:
    settings = with_network()
    names = parameter_names(settings, "ann", build_game(settings))
    assert names.omega == ()
    assert names.theta


@pytest.mark.parametrize(
    ("cost", "words"),
    [
        ({**NETWORK, "inputs": ["shade_1"]}, "shade_1.*this game has .*near_1_2.*take some"),
        ({**NETWORK, "inputs": []}, "inputs"),
        ({**NETWORK, "bound": 0}, "bound"),
        ({**NETWORK, "apart": -1}, "apart"),
        ({"kind": "tree"}, "tree"),
    ],
)
def test_wrong_settings_are_refused_by_name(cost: dict[str, Any], words: str) -> None:
    with pytest.raises((ValueError, ExperimentError), match=words):
        experiment({"algorithm.cost": cost})


def test_a_network_too_large_is_refused() -> None:
    big = {"map": "\n".join(["." * 12] * 12), "starts": [[[0, 0], [0, 2]]], "goals": [[1, 2], [1, 0]], "horizon": 4}
    content = changed({"game": big, "algorithm.cost": {**NETWORK, "width": 1000}})
    with pytest.raises((ValueError, ExperimentError), match="20736 joint states.*take fewer"):
        Experiment.model_validate(content)


def test_drones_refuse_a_network() -> None:
    with pytest.raises((ValueError, ExperimentError), match="tells networks nothing.*take linear"):
        drone_experiment({"algorithm.cost": NETWORK})


def test_methods_that_forbid_features_refuse_a_network() -> None:
    with pytest.raises(ExperimentError, match=r"me_greedy.*take me_gradient"):
        build_method(with_network(), "me_greedy")
    assert build_method(with_network(), "me_gradient").initial_state().parameters.omega.any()


def test_the_picture_of_a_network_has_a_row_for_what_distances_cost() -> None:
    settings = alone()
    game = build_game(settings)
    first = build_learner(settings, "ann").initial_state().parameters
    policy = evaluation_policy(settings, "ann", game)(first)
    constraints = np.zeros(len(game.cost_features.names), dtype=np.bool_)
    figure = game.figure({"ann": Learned(policy, first.omega, constraints)}, 0.0, 0)
    row = figure.axes[-1]
    (curve,) = row.lines
    np.testing.assert_allclose(curve.get_ydata(), NETWORK["bound"] / 2)  # type: ignore[operator]
    assert curve.get_xdata()[:3].tolist() == pytest.approx([0, 1, 2**0.5])  # type: ignore[index,union-attr]
    assert len(figure.axes) == 3
    plain = build_game(experiment({"game.horizon": 8}))
    of_features = Learned(policy, np.zeros(len(constraints)), constraints)
    assert len(plain.figure({"ann": of_features}, 0.0, 0).axes) == 2
