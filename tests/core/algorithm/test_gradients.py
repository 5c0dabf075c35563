"""Gradients against central finite differences: of a trajectory's log-likelihood, and of the dual G.

Transitions are deterministic, so sum_t gamma^t log pi_t(a_t|s_t) = J(zeta) + omega^T mu(zeta) - V_0(s_0), and
its gradient is that of zeta less its expectation under pi from s_0. The dual is
G(omega; theta) = E_{P_0} V_0 - omega^T mu(D) - J_theta(D) with D the mean over the window's demonstrations.
"""

from collections.abc import Callable

import numpy as np
import pytest
from games import central_differences, discounted_sums, hallway, log_likelihoods, patrol

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.consensus.strict import StrictMixer, StrictState
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.occupancy import ExactOccupancy, rollouts
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner, SoftBellmanPolicy, soft_bellman_policy
from mabirds_core.rewards.models import LinearReward

TOLERANCE = 2e-9

Objective = Callable[[Parameters], float]


def from_one_start(discount: float = 0.8) -> PatrolGame:
    """2x3 cells, two experts, one start."""
    return patrol("...\n.#.", [((0, 0), (0, 2))], ((1, 2), (0, 0)), discount=discount)


def some_parameters(game: PatrolGame) -> Parameters:
    rng = np.random.default_rng(3)
    sizes = len(game.reward_features.names), len(game.cost_features.names)
    return Parameters(rng.normal(size=sizes[0]), rng.normal(size=sizes[1]))


def some_trajectories(game: PatrolGame, count: int) -> list[Trajectories]:
    """Of a policy that has nothing to do with the parameters."""
    uniform = soft_bellman_policy(game, np.zeros((game.n_states, game.n_actions)))
    return [rollouts(game, uniform, 1, np.random.default_rng(seed)) for seed in range(count)]


def evaluation_policy(game: PatrolGame, parameters: Parameters) -> SoftBellmanPolicy:
    return SoftBellmanPlanner(game, LinearReward(game.reward_features), game.cost_features).plan(*parameters)


def totals(game: PatrolGame, trajectory: Trajectories) -> Parameters:
    """grad J(zeta), mu(zeta)."""
    visitation = discounted_visitation(trajectory, game.discount)
    return Parameters(game.reward_features.total(visitation), game.cost_features.total(visitation))


def exact_learner(game: PatrolGame, window: int) -> Learner:
    reward = LinearReward(game.reward_features)
    planner = SoftBellmanPlanner(game, reward, game.cost_features)
    schedule, steps = EdgeSchedule(("alone",), (frozenset(),)), PaperSteps(alpha=1, beta=1)
    estimator = GradientEstimator(game, reward, planner, ExactOccupancy(game), "initial")
    return Learner(0, estimator, StrictMixer("alone", schedule), steps, estimator.window(window), seed=0)


def gradient(game: PatrolGame, at: Parameters, n: int, window: int, demonstrations: list[Trajectories]) -> Parameters:
    """Of a learner at iteration n that has seen ``demonstrations``, the newest first."""
    learner = exact_learner(game, window)
    memory = learner.memory
    for earlier in reversed(demonstrations[1:]):
        memory = memory.add(earlier)
    return learner.step(LearnerState(n, StrictState(at), memory, {}), demonstrations[0], {}).gradient


def differences(objective: Objective, at: Parameters) -> Parameters:
    """The gradient of ``objective`` in theta and in omega by central finite differences."""
    return Parameters(
        central_differences(lambda theta: objective(Parameters(theta, at.omega)), at.theta),
        central_differences(lambda omega: objective(Parameters(at.theta, omega)), at.omega),
    )


def assert_close(found: Parameters, expected: Parameters) -> None:
    np.testing.assert_allclose(found.theta, expected.theta, rtol=0, atol=TOLERANCE)
    np.testing.assert_allclose(found.omega, expected.omega, rtol=0, atol=TOLERANCE)
    assert np.abs(expected.theta).max() > 0.01
    assert np.abs(expected.omega).max() > 0.01


def log_likelihood(game: PatrolGame, trajectory: Trajectories) -> Objective:
    """sum_t gamma^t log pi_t(a_t | s_t) as a function of theta and omega."""
    return lambda at: float(discounted_sums(game, log_likelihoods(evaluation_policy(game, at), trajectory))[0])


def dual(game: PatrolGame, demonstrations: list[Trajectories]) -> Objective:
    """G(omega; theta) for the mean over ``demonstrations``."""
    mean = Parameters(
        *(np.mean(parts, axis=0) for parts in zip(*(totals(game, d) for d in demonstrations), strict=True))
    )

    def value(at: Parameters) -> float:
        expected_value = game.initial_distribution @ evaluation_policy(game, at).values[0]
        return float(expected_value - at.theta @ mean.theta - at.omega @ mean.omega)

    return value


@pytest.mark.parametrize("discount", [0.8, 1.0])
def test_gradient_of_the_log_likelihood_is_that_of_the_trajectory_less_its_expectation(
    discount: float,
) -> None:
    game = from_one_start(discount)
    at = some_parameters(game)
    (trajectory,) = some_trajectories(game, 1)
    own, visitation = (
        totals(game, trajectory),
        ExactOccupancy(game)(evaluation_policy(game, at), np.random.default_rng()),
    )
    expected = game.reward_features.total(visitation), game.cost_features.total(visitation)
    found = Parameters(own.theta - expected[0], own.omega - expected[1])
    assert_close(found, differences(log_likelihood(game, trajectory), at))


def test_a_learner_descends_the_negative_log_likelihood_of_its_demonstration() -> None:
    game = from_one_start()
    at = some_parameters(game)
    (trajectory,) = some_trajectories(game, 1)
    likelihood = log_likelihood(game, trajectory)
    assert_close(gradient(game, at, 1, 1, [trajectory]), differences(lambda where: -likelihood(where), at))


def test_gradient_of_a_linear_reward_model_is_that_of_the_return() -> None:
    game = from_one_start()
    model, (trajectory,) = LinearReward(game.reward_features), some_trajectories(game, 1)
    visitation = discounted_visitation(trajectory, game.discount)

    def discounted_return(theta: Vector) -> float:
        return float(discounted_sums(game, model.table(theta)[trajectory.states, trajectory.actions])[0])

    theta = some_parameters(game).theta
    found = model.gradient(theta, visitation)
    np.testing.assert_allclose(found, central_differences(discounted_return, theta), rtol=0, atol=TOLERANCE)


@pytest.mark.parametrize("window", [1, 3])
def test_a_learners_gradient_is_that_of_the_dual_over_its_window(window: int) -> None:
    game = hallway()
    at, demonstrations = some_parameters(game), some_trajectories(game, window)
    found = gradient(game, at, window, window, demonstrations)
    assert_close(found, differences(dual(game, demonstrations), at))


def test_while_the_window_fills_the_gradient_is_the_filled_share_of_the_duals() -> None:
    game = hallway()
    at, demonstrations = some_parameters(game), some_trajectories(game, 2)
    objective, found = dual(game, demonstrations), gradient(game, at, 2, 3, demonstrations)
    assert_close(found, differences(lambda where: 2 / 3 * objective(where), at))


def test_the_dual_is_convex_along_lines() -> None:
    game, rng = hallway(), np.random.default_rng(8)
    objective, at = dual(game, some_trajectories(game, 1)), some_parameters(game)
    for _ in range(20):
        along = Parameters(rng.normal(size=at.theta.shape), rng.normal(size=at.omega.shape))
        ends = [Parameters(at.theta + side * along.theta, at.omega + side * along.omega) for side in (-1, 1)]
        assert objective(at) < np.mean([objective(end) for end in ends])
