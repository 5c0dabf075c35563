"""Learners and central methods of the drone game: bits that repeat, checkpoints, gradients by hand, likelihoods."""

from typing import Any

import numpy as np
import pytest
from arenas import drone_experiment, drone_game, drone_streams
from experiments import demonstrations, experiment
from games import central_differences
from identity import assert_same_histories, bits

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.memory import WindowMemory, stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.algorithm.storage import from_arrays, to_arrays
from mabirds_core.baselines.bics import Bics
from mabirds_core.consensus.strict import StrictState
from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.experiment.assembly import (
    build_estimator,
    build_game,
    build_learner,
    build_method,
    build_reward,
    evaluation_policy,
    method_names,
)
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import simulate, simulate_central
from mabirds_core.games.drones.arrival import ArrivingDroneReward, ArrivingNeuralDroneReward
from mabirds_core.games.drones.demonstrated import log_ratios
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.rewards import LinearDroneReward, NeuralDroneReward, TrueDroneReward
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.soft_bellman import soft_bellman_policy

NOT_LATE = {"algorithm.reward": {"kind": "linear", "lateness": False}}
NEURAL = {"algorithm.reward": {"kind": "neural", "hidden": 4, "bound": 5.0}}
FROM_DEMONSTRATIONS = {"algorithm.rollout_start": "demonstration"}
ALONE = {"game.drones": [{"start": (0.3, 0.3), "goal_region": {"centre": (1.3, 1.0), "radius": 0.2}}]}

every_kind = pytest.mark.parametrize(
    "changes", [{}, NEURAL, FROM_DEMONSTRATIONS, ALONE], ids=["linear", "neural", "from demonstrations", "alone"]
)


@every_kind
def test_the_same_seed_gives_the_same_bits_and_another_seed_others(changes: dict[str, Any]) -> None:
    settings = drone_experiment(changes)
    streams = drone_streams(settings)
    first, again = (simulate(settings, streams) for _ in range(2))
    assert_same_histories(first, again)
    other = simulate(drone_experiment({**changes, "seed": 4}), streams)
    assert (other["ann"][-1].omega != first["ann"][-1].omega).any()


def test_every_learner_learns_both_parameters() -> None:
    settings = drone_experiment()
    for parameters in simulate(settings, drone_streams(settings)).values():
        assert len(parameters) == settings.iterations + 1
        assert not parameters[0].theta.any()
        assert parameters[-1].theta.any()
        assert parameters[-1].omega.any()


def updated(learner: Learner, state: LearnerState, stream: list[Trajectories]) -> LearnerState:
    """After one more update with no neighbours."""
    return learner.step(state, stream[state.iteration - 1], {}).state


@every_kind
def test_a_learner_goes_on_from_its_arrays_bit_for_bit(changes: dict[str, Any]) -> None:
    settings = drone_experiment({**changes, "learners": ["ann"]})
    learner, stream = build_learner(settings, "ann"), drone_streams(settings)["ann"]
    state = learner.initial_state()
    for _ in range(settings.iterations - 1):
        arrays = {name: values.copy() for name, values in to_arrays(learner, state).items()}
        restored = from_arrays(build_learner(settings, "ann"), state.iteration, arrays)
        assert isinstance(restored.memory, WindowMemory)
        assert len(restored.memory.newest) == min(restored.memory.length - 1, state.iteration - 1)
        after, expected = (updated(learner, one, stream) for one in (restored, state))
        assert bits(after.parameters) == bits(expected.parameters)
        state = expected


def test_a_checkpoint_holds_parameters_and_the_demonstrations_of_the_window() -> None:
    settings = drone_experiment({"learners": ["ann"]})
    learner, stream = build_learner(settings, "ann"), drone_streams(settings)["ann"]
    state = updated(learner, updated(learner, learner.initial_state(), stream), stream)
    arrays = to_arrays(learner, state)
    assert set(arrays) == {"theta", "omega", *(f"recent.{k}.{of}" for k in (0, 1) for of in ("states", "actions"))}
    np.testing.assert_array_equal(arrays["recent.0.states"], stream[1].states[0])
    np.testing.assert_array_equal(arrays["recent.1.actions"], stream[0].actions[0])


@pytest.mark.parametrize("name", ["theta", "omega", "recent.0.states"])
def test_arrays_of_another_arena_are_refused(name: str) -> None:
    settings = drone_experiment({"learners": ["ann"]})
    learner = build_learner(settings, "ann")
    arrays = to_arrays(learner, updated(learner, learner.initial_state(), drone_streams(settings)["ann"]))
    arrays[name] = arrays[name][:-1]
    with pytest.raises(MabirdsError, match="expected"):
        from_arrays(learner, 2, arrays)


def test_a_learners_gradient_is_that_of_rollouts_less_demonstrations() -> None:
    """With its own generator, (seed, learner, iteration), and rollouts from P_0."""
    settings = drone_experiment({"learners": ["ann"], "algorithm.window": 1, "algorithm.rollout_start": "initial"})
    learner, game, demonstration = (
        build_learner(settings, "ann"),
        drone_game(settings),
        drone_streams(settings)["ann"][0],
    )
    rng = np.random.default_rng(0)
    at = Parameters(*(rng.normal(size=values.shape) for values in learner.initial_state().parameters))
    found = learner.step(LearnerState(3, StrictState(at), learner.memory, {}), demonstration, {}).gradient
    rng = np.random.default_rng([3, 0, 3])
    reward = ArrivingDroneReward(game)
    policy = LatticePlanner(game, reward, 0.173, 1.0).plan(*at, rng=rng)
    imagined = drone_rollouts(game, policy, 6, rng)
    for part, features in zip(found, (reward, game.cost_features), strict=True):
        totals = [features.total(discounted_visitation(of, 0.9)) for of in (imagined, demonstration)]
        np.testing.assert_allclose(part, totals[0] - totals[1], rtol=0, atol=1e-12)


def test_rollouts_begin_where_demonstrations_did() -> None:
    """Of two demonstrations that begin at the same place: the visitation at step 0 cancels out but for the effort."""
    settings = drone_experiment({**FROM_DEMONSTRATIONS, "game.discount": 1e-9})
    game, demonstration = drone_game(settings), drone_streams(settings)["ann"][0]
    estimator = build_estimator(settings, game, build_reward(settings, game))
    memory = estimator.window(1).add(demonstration)
    gradient = estimator(estimator.initial_parameters(0), memory, np.random.default_rng(0)).gradient
    np.testing.assert_allclose(gradient.theta, 0, atol=1e-8)
    np.testing.assert_allclose(gradient.omega[:-2], 0, atol=1e-8)
    initial = drone_experiment({"game.discount": 1e-9, "algorithm.rollout_start": "initial"})
    free = build_estimator(initial, game, build_reward(settings, game))
    gradient = free(free.initial_parameters(0), memory, np.random.default_rng(0)).gradient
    assert np.abs(gradient.theta).max() > 1e-3


@pytest.mark.parametrize("changes", [{}, NEURAL], ids=["linear", "neural"])
def test_learning_makes_demonstrations_that_were_not_seen_likelier(changes: dict[str, Any]) -> None:
    steps = {"algorithm.steps": {"alpha": 1.0, "beta": 1.0}, "algorithm.rollouts": 40, **FROM_DEMONSTRATIONS}
    settings = drone_experiment({**steps, **changes, "iterations": 20, "demonstrations.per_learner": 20})
    game = drone_game(settings)
    history = simulate(settings, drone_streams(settings))
    unseen = stacked(drone_streams(settings, seed=1)["ann"])
    meaning = evaluation_policy(settings, "ann", game)
    before, after = (log_ratios(meaning(history["ann"][n]), unseen).mean() for n in (0, -1))
    assert after > before + 3


def test_every_drone_method_but_me_greedy_runs_and_repeats() -> None:
    settings = drone_experiment({"iterations": 3})
    streams = drone_streams(settings)
    for name in set(method_names()) - {"me_greedy"}:
        one, again = (simulate_central(settings, name, streams) for _ in range(2))
        assert_same_histories(one, again)
        assert one[name][-1].omega.any()


@pytest.mark.parametrize("call", [build_method, evaluation_policy])
def test_me_greedy_is_refused_for_drones(call: Any) -> None:
    settings = drone_experiment()
    arguments = (settings, "me_greedy") if call is build_method else (settings, "me_greedy", build_game(settings))
    with pytest.raises(ExperimentError, match="method me_greedy is made for tabular games, and the game is drones"):
        call(*arguments)


@pytest.mark.parametrize(
    ("changes", "model"),
    [
        ({}, ArrivingDroneReward),
        (NOT_LATE, LinearDroneReward),
        (NEURAL, ArrivingNeuralDroneReward),
        ({"algorithm.reward": {**NEURAL["algorithm.reward"], "lateness": False}}, NeuralDroneReward),
    ],
)
def test_the_reward_model_is_that_of_the_settings(changes: dict[str, Any], model: type[Any]) -> None:
    settings = drone_experiment(changes)
    assert isinstance(build_learner(settings, "ann").estimator.reward, model)
    assert isinstance(me_gradient(settings).estimator.reward, TrueDroneReward)
    planner: Any = build_learner(settings, "ann").estimator.planner
    assert (planner.spacing, planner.temperature) == (0.173, 1.0)


def me_gradient(of: Experiment) -> Bics:
    method = build_method(of, "me_gradient")
    assert isinstance(method, Bics)
    return method


def test_me_gradient_of_patrols_ascends_the_likelihood_under_the_true_reward() -> None:
    """Its first step is alpha(1) times the gradient of the mean log-likelihood, by central finite differences."""
    settings = experiment({"algorithm.expectation": "exact", "baselines": {"me_gradient": {}}})
    game = PatrolGame(settings.game)
    seen = stacked([stream[0] for stream in demonstrations(settings).values()])

    def likelihood(omega: Any) -> float:
        policy = soft_bellman_policy(game, game.task_reward + game.cost_features.table(omega))
        logs = [
            policy.log_probabilities(t, states)[np.arange(len(states)), actions]
            for t, (states, actions) in enumerate(zip(seen.states.T, seen.actions.T, strict=True))
        ]
        return float(game.discount ** np.arange(len(logs)) @ np.mean(logs, axis=1))

    method = me_gradient(settings)
    first = method.initial_state()
    assert first.parameters.theta.shape == (0,)
    after = method.update(first, seen).parameters.omega
    expected = 2.0 * central_differences(likelihood, np.zeros(len(game.cost_features.names)))
    np.testing.assert_allclose(after, expected, rtol=0, atol=1e-8)
    assert np.abs(after).max() > 0.1


def test_me_gradient_of_drones_descends_the_difference_of_cost_features_alone() -> None:
    baselines = {"me_gradient": {"steps": {"alpha": 3.0, "beta": 1.0}}}
    settings = drone_experiment({"baselines": baselines, "algorithm.rollout_start": "initial"})
    game, method = drone_game(settings), me_gradient(settings)
    seen = stacked([stream[0] for stream in drone_streams(settings).values()])
    after = method.update(method.initial_state(), seen).parameters
    none = np.zeros(len(game.cost_features.names))
    rng = np.random.default_rng([3, 1])
    policy = LatticePlanner(game, TrueDroneReward(game), 0.173, 1.0).plan(np.zeros(0), none, rng=rng)
    imagined = drone_rollouts(game, policy, 6, rng)
    totals = [game.cost_features.total(discounted_visitation(of, 0.9)) for of in (imagined, seen)]
    share = 1 / settings.algorithm.window
    np.testing.assert_allclose(after.omega, -3.0 * share * (totals[0] - totals[1]), rtol=0, atol=1e-12)
    assert after.theta.shape == (0,)


def test_policies_are_judged_with_the_reward_that_their_parameters_belong_to() -> None:
    settings = drone_experiment()
    game = drone_game(settings)
    omega = np.random.default_rng(0).normal(size=len(game.cost_features.names))
    starts = game.starts(5, np.random.default_rng(2))
    found = evaluation_policy(settings, "me_gradient", game)(Parameters(np.zeros(0), omega))
    expected = LatticePlanner(game, TrueDroneReward(game), 0.173, 1.0).plan(np.zeros(0), omega)
    np.testing.assert_array_equal(found.values(0, starts), expected.values(0, starts))
    reward = ArrivingDroneReward(game)
    theta = np.random.default_rng(1).normal(size=reward.size)
    found = evaluation_policy(settings, "bics", game)(Parameters(theta, omega))
    expected = LatticePlanner(game, reward, 0.173, 1.0).plan(theta, omega)
    np.testing.assert_array_equal(found.values(0, starts), expected.values(0, starts))
