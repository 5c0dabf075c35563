"""Central methods with the default step rule: nothing is given, and the loss of all demonstrations falls."""

from functools import cache
from typing import Any

import numpy as np
import pytest
from experiments import demonstrations, experiment
from scipy.optimize import minimize

from mabirds_core.algorithm.adaptive_steps import AdaptiveSteps
from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.memory import RunningMean, stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.baselines.interface import CentralState
from mabirds_core.experiment.assembly import build_method
from mabirds_core.experiment.simulate import simulate_central
from mabirds_core.games.interface import Trajectories, discounted_visitation

SETTINGS = experiment(
    {
        "algorithm": {},
        "game.horizon": 6,
        "game.starts": [[[0, 0], [0, 2]], [[1, 0], [0, 1]]],
        "iterations": 24,
        "demonstrations.per_learner": 24,
    }
)
STREAMS = demonstrations(SETTINGS)
METHODS = ("bics", "ftl", "dlm", "me_gradient")

every_method = pytest.mark.parametrize("name", METHODS)


def method_of(name: str) -> Any:
    return build_method(SETTINGS, name)


def loss_and_gradient(estimator: GradientEstimator, at: Parameters, shown: Trajectories) -> tuple[float, Vector]:
    """Of G = mean V_0(s_0) - J_theta(D) - omega^T mu(D) over the starts and the demonstrations; exact."""
    game: Any = estimator.game
    reward: Any = estimator.reward
    policy: Any = estimator.planner.plan(*at)
    seen, starts = discounted_visitation(shown, game.discount), shown.states[:, 0]
    imagined = estimator.expectation(policy, np.random.default_rng(0), starts)
    of_reward = float((reward.table(at.theta)[seen.states, seen.actions] * seen.weights).sum())
    loss = float(policy.values[0][starts].mean()) - of_reward - float(at.omega @ game.cost_features.total(seen))
    gradients = (
        reward.gradient(at.theta, imagined) - reward.gradient(at.theta, seen),
        game.cost_features.total(imagined) - game.cost_features.total(seen),
    )
    return loss, np.concatenate(gradients)


@cache
def everything() -> Trajectories:
    return stacked([demonstration for stream in STREAMS.values() for demonstration in stream])


@cache
def history_of(name: str) -> tuple[Parameters, ...]:
    return tuple(simulate_central(SETTINGS, name, STREAMS)[name])


def least_loss(estimator: GradientEstimator) -> float:
    """By L-BFGS, which sees all demonstrations at once."""
    size = estimator.reward.size

    def objective(values: Vector) -> tuple[float, Vector]:
        return loss_and_gradient(estimator, Parameters(values[:size], values[size:]), everything())

    start = np.concatenate(estimator.initial_parameters(SETTINGS.seed))
    return float(minimize(objective, start, jac=True, method="L-BFGS-B", options={"maxiter": 200}).fun)


@every_method
def test_it_takes_the_default_rule_of_the_algorithm(name: str) -> None:
    method = method_of(name)
    assert method.steps == AdaptiveSteps()
    if name in {"bics", "me_gradient"}:
        assert isinstance(method.memory, RunningMean)


@every_method
def test_it_comes_most_of_the_way_to_the_least_loss_of_all_demonstrations(name: str) -> None:
    estimator = method_of(name).estimator
    losses = [loss_and_gradient(estimator, at, everything())[0] for at in history_of(name)]
    least = least_loss(estimator)
    assert losses[0] - losses[-1] > 0.85 * (losses[0] - least)


@every_method
def test_the_rules_state_is_carried_from_one_iteration_to_the_next(name: str) -> None:
    """Without it the second iteration would end elsewhere."""
    method, shown = method_of(name), [stacked([stream[n] for stream in STREAMS.values()]) for n in (0, 1)]
    state: CentralState = method.update(method.initial_state(), shown[0])
    assert state.rule.keys() == method.steps.initial(state.parameters).keys()
    forgetful = state._replace(rule=method.steps.initial(state.parameters))
    after, other = method.update(state, shown[1]), method.update(forgetful, shown[1])
    part = "theta" if name == "dlm" else "omega"  # whose inner loop begins anew with its omega
    assert (getattr(after.parameters, part) != getattr(other.parameters, part)).any()
