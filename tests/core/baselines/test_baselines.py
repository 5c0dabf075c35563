"""Central methods against hand-made loops, finite differences' gradient and exhaustive search on tiny games."""

from collections.abc import Callable

import numpy as np
import pytest
from experiments import demonstrations, experiment
from games import all_trajectories, alone, central_differences, hallway, patrol, probabilities, random_policy, square

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.learner import Learner
from mabirds_core.algorithm.memory import WindowMemory, stacked
from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Mask, Vector
from mabirds_core.baselines.bics import Bics
from mabirds_core.baselines.dlm import Dlm
from mabirds_core.baselines.ftl import Ftl
from mabirds_core.baselines.me_greedy import MeGreedy, violation_probabilities
from mabirds_core.consensus.generators import complete_edges, static
from mabirds_core.consensus.strict import StrictMixer
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_method, evaluation_policy, method_names
from mabirds_core.experiment.simulate import simulate, simulate_central
from mabirds_core.games.interface import Trajectories, discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.metrics.metrics import exact_imitation
from mabirds_core.planners.occupancy import ExactOccupancy, rollouts
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner, soft_bellman_policy
from mabirds_core.rewards.models import LinearReward

STEPS = PaperSteps(alpha=2.0, beta=0.8, eta1=0.6, eta2=0.7)


def estimator(game: PatrolGame) -> GradientEstimator:
    reward = LinearReward(game.reward_features)
    planner = SoftBellmanPlanner(game, reward, game.cost_features)
    return GradientEstimator(game, reward, planner, ExactOccupancy(game), "initial")


def bics(game: PatrolGame, window: int) -> Bics:
    return Bics(estimator(game), STEPS, estimator(game).window(window), seed=0)


def one_start() -> PatrolGame:
    """2x3 cells, two experts; every trajectory begins alike, so that a loss can be stationary."""
    return patrol("...\n.#.", [((0, 0), (0, 2))], ((1, 2), (0, 0)), discount=0.8)


def pooled(game: PatrolGame, streams: int, seed: int) -> Trajectories:
    """One demonstration a stream, of a policy that has nothing to do with the methods."""
    uniform = soft_bellman_policy(game, np.zeros((game.n_states, game.n_actions)))
    return rollouts(game, uniform, streams, np.random.default_rng(seed))


def gradient_by_differences(game: PatrolGame, at: Parameters, observed: Trajectories) -> Parameters:
    """Of G = E V_0 - theta^T f(D) - omega^T mu(D), by central finite differences."""
    seen = discounted_visitation(observed, game.discount)
    of_reward, of_cost = game.reward_features.total(seen), game.cost_features.total(seen)
    planner = estimator(game).planner

    def loss(theta: Vector, omega: Vector) -> float:
        values = planner.plan(theta, omega).values[0]  # type: ignore[attr-defined]
        return float(game.initial_distribution @ values - theta @ of_reward - omega @ of_cost)

    return Parameters(
        central_differences(lambda theta: loss(theta, at.omega), at.theta),
        central_differences(lambda omega: loss(at.theta, omega), at.omega),
    )


def assert_close(found: Parameters, expected: Parameters, tolerance: float = 1e-7) -> None:
    np.testing.assert_allclose(found.theta, expected.theta, rtol=0, atol=tolerance)
    np.testing.assert_allclose(found.omega, expected.omega, rtol=0, atol=tolerance)


def test_bics_descends_the_mean_loss_of_the_newest_demonstrations() -> None:
    game = hallway()
    method = bics(game, window=2)
    state, seen = method.initial_state(), []
    for n in range(1, 4):
        seen.append(pooled(game, streams=3, seed=n))
        recent = stacked(seen[-2:])
        gradient = gradient_by_differences(game, state.parameters, recent)
        share = min(n, 2) / 2
        expected = Parameters(
            state.parameters.theta - 0.8 / n**0.7 * share * gradient.theta,
            state.parameters.omega - 2.0 / n**0.6 * share * gradient.omega,
        )
        state = method.update(state, seen[-1])
        assert_close(state.parameters, expected)
        assert (state.iteration, state.work) == (n + 1, (n, n))


def test_one_bics_step_is_the_mean_of_the_learners_steps() -> None:
    """Where all start alike and average with everybody, pooling and exchanging are the same."""
    game, streams = hallway(), pooled(hallway(), streams=3, seed=4)
    schedule = static(("a", "b", "c"), complete_edges(3))
    of = estimator(game)
    learners = [Learner(v, of, StrictMixer(name, schedule), STEPS, of.window(1), 0) for v, name in enumerate("abc")]
    start = learners[0].initial_state()
    after = [
        learner.step(
            start,
            Trajectories(streams.states[[v]], streams.actions[[v]]),
            {name: start.parameters for name in "abc" if name != learner.mixer.name},
        ).state.parameters
        for v, learner in enumerate(learners)
    ]
    mean = Parameters(*(np.mean(parts, axis=0) for parts in zip(*after, strict=True)))
    method = bics(game, window=1)
    assert_close(method.update(method.initial_state(), streams).parameters, mean, tolerance=1e-12)


def test_ftl_ends_where_the_sum_of_all_losses_is_nearly_stationary() -> None:
    game, tolerance = one_start(), 0.1
    method = Ftl(estimator(game), STEPS, tolerance, max_steps=5000, seed=0)
    state, seen = method.initial_state(), []
    for n in range(1, 4):
        seen.append(pooled(game, streams=2, seed=n))
        before = state
        state = method.update(state, seen[-1])
        at_start, at_end = (gradient_by_differences(game, one.parameters, stacked(seen)) for one in (before, state))
        assert max(np.abs(part).max() for part in at_start) > tolerance
        assert max(np.abs(part).max() for part in at_end) <= tolerance + 1e-6
        made = state.work.gradient_steps - before.work.gradient_steps
        assert made >= 2
        assert state.work.policy_solves - before.work.policy_solves == made + 1


def test_ftl_stops_after_its_max_steps() -> None:
    game = hallway()
    method = Ftl(estimator(game), STEPS, tolerance=1e-9, max_steps=3, seed=0)
    first = method.update(method.initial_state(), pooled(game, 2, seed=1))
    assert first.work == (3, 4)
    assert method.update(first, pooled(game, 2, seed=2)).work == (6, 8)


def test_the_steps_of_ftl_decay_over_all_iterations() -> None:
    game, seen = hallway(), [pooled(hallway(), 2, seed=n) for n in (1, 2)]
    method = Ftl(estimator(game), STEPS, tolerance=1e-9, max_steps=1, seed=0)
    first = method.update(method.initial_state(), seen[0])
    gradient = gradient_by_differences(game, first.parameters, stacked(seen))
    expected = Parameters(
        first.parameters.theta - 0.8 / 2**0.7 * gradient.theta, first.parameters.omega - 2.0 / 2**0.6 * gradient.omega
    )
    assert_close(method.update(first, seen[1]).parameters, expected)


def test_dlm_solves_the_inner_problem_and_then_steps_once_in_theta() -> None:
    game, tolerance = one_start(), 0.02
    method = Dlm(estimator(game), STEPS, window=2, tolerance=tolerance, max_steps=5000, seed=0)
    state, seen = method.initial_state(), []
    for n in range(1, 4):
        seen.append(pooled(game, streams=2, seed=n))
        before, state = state, method.update(state, seen[-1])
        at_solution = Parameters(before.parameters.theta, state.parameters.omega)
        gradient = gradient_by_differences(game, at_solution, stacked(seen[-2:]))
        assert np.abs(gradient.omega).max() <= tolerance + 1e-6
        expected = before.parameters.theta - 0.8 / n**0.7 * gradient.theta
        np.testing.assert_allclose(state.parameters.theta, expected, rtol=0, atol=1e-7)
        assert state.work.policy_solves - before.work.policy_solves >= 3


def test_dlm_stops_its_inner_loop_after_its_max_steps() -> None:
    game = hallway()
    method = Dlm(estimator(game), STEPS, window=1, tolerance=1e-9, max_steps=3, seed=0)
    assert method.update(method.initial_state(), pooled(game, 2, seed=1)).work == (4, 4)


def masses_by_enumeration(game: PatrolGame, constraints: Mask) -> Vector:
    """P(zeta breaks k | C) for every feature k, over all trajectories one by one."""
    trajectories = all_trajectories(game)
    touched = np.array([broken(game, states, actions) for states, actions in zip(*trajectories, strict=True)])
    reward = game.task_reward[trajectories.states, trajectories.actions].sum(axis=1)
    in_time = game.goal[trajectories.states[:, game.deadline :]].all(axis=1)
    allowed = in_time & ~(touched & constraints).any(axis=1)
    weights = np.where(allowed, np.exp(reward), 0.0)
    by_start = np.zeros(len(weights))
    for start in np.unique(trajectories.states[:, 0]):
        here = trajectories.states[:, 0] == start
        by_start[here] = game.initial_distribution[start] * weights[here] / weights[here].sum()
    return np.asarray(by_start @ touched)


def broken(game: PatrolGame, states: Vector, actions: Vector) -> Mask:
    """Features that one trajectory touches."""
    one = discounted_visitation(Trajectories(states[None], actions[None]), 1.0)
    return game.cost_features.total(one) > 0


def corridor_with_a_shortcut() -> PatrolGame:
    """One expert, 2x3 cells; the obstacle lies on one of two equally short ways."""
    return patrol("...\n.#.", [((1, 0),)], ((1, 2),), horizon=5)


@pytest.mark.parametrize("make", [corridor_with_a_shortcut, lambda: square(horizon=2)])
def test_me_greedy_adds_what_exhaustive_search_would_add(make: Callable[[], PatrolGame]) -> None:
    game = make()
    method = MeGreedy(game, least_mass=0.01)
    demonstration = one_clean_way(game)
    seen = broken(game, demonstration.states[0], demonstration.actions[0])
    state, learned = method.initial_state(), np.zeros(len(game.cost_features.names), dtype=bool)
    for _ in range(4):
        masses = np.where(learned | seen, 0.0, masses_by_enumeration(game, learned))
        if masses.max() >= 0.01:
            learned[masses.argmax()] = True
        state = method.update(state, demonstration)
        np.testing.assert_array_equal(state.parameters.omega < 0, learned)
    assert learned.any()


def one_clean_way(game: PatrolGame) -> Trajectories:
    """The first trajectory of all that is in time and breaks no true constraint."""
    everything = all_trajectories(game)
    for states, actions in zip(*everything, strict=True):
        if game.goal[states[-1]] and not game.violation[states, actions].any():
            return Trajectories(states[None], actions[None])
    raise AssertionError("no clean way")


def test_me_greedy_stops_where_no_constraint_removes_enough() -> None:
    game = corridor_with_a_shortcut()
    first_mass = masses_by_enumeration(game, np.zeros(6 + 2, dtype=bool))
    demonstration = one_clean_way(game)
    seen = broken(game, demonstration.states[0], demonstration.actions[0])
    best = float(first_mass[~seen].max())
    assert 0.05 < best < 0.999
    for least, count in ((best - 1e-6, 1), (best + 1e-6, 0)):
        method = MeGreedy(game, least)
        assert (method.update(method.initial_state(), demonstration).parameters.omega < 0).sum() == count


def test_me_greedy_withdraws_a_constraint_that_a_demonstration_breaks() -> None:
    game = corridor_with_a_shortcut()
    method, clean = MeGreedy(game, 0.01), one_clean_way(game)
    state = method.update(method.initial_state(), clean)
    (k,) = np.flatnonzero(state.parameters.omega)
    everything = all_trajectories(game)
    breaking = next(
        Trajectories(states[None], actions[None])
        for states, actions in zip(*everything, strict=True)
        if broken(game, states, actions)[k]
    )
    assert method.update(state, breaking).parameters.omega[k] == 0


def test_a_policy_of_me_greedy_breaks_no_learned_constraint_and_is_in_time() -> None:
    game = corridor_with_a_shortcut()
    method = MeGreedy(game, 0.01)
    policy = method.policy(Parameters(np.zeros(0), -game.true_constraints.astype(float)))
    assert exact_imitation(game, policy) == pytest.approx((0.0, 1.0))


@pytest.mark.parametrize("make", [alone, square])
def test_violation_probabilities_are_those_of_all_trajectories(make: Callable[[], PatrolGame]) -> None:
    game = make()
    policy = random_policy(game, np.random.default_rng(2))
    everything = all_trajectories(game)
    touched = np.array([broken(game, states, actions) for states, actions in zip(*everything, strict=True)])
    expected = probabilities(game, policy, everything) @ touched
    np.testing.assert_allclose(violation_probabilities(game, policy), expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", method_names())
def test_a_method_runs_on_all_streams_of_an_experiment(name: str) -> None:
    settings = experiment({"algorithm.expectation": "exact", "game.horizon": 6})
    streams = demonstrations(settings)
    history = simulate_central(settings, name, streams)
    assert list(history) == [name]
    assert len(history[name]) == settings.iterations + 1
    fewer = {learner: list(reversed(stream)) for learner, stream in streams.items()}
    other = simulate_central(settings, name, fewer)
    if name != "me_greedy":  # which depends on the demonstrations' features only
        assert not np.array_equal(history[name][1].omega, other[name][1].omega)


def test_methods_take_their_settings_from_the_experiment() -> None:
    baselines = {
        "ftl": {"tolerance": 0.3, "max_steps": 7, "steps": {"alpha": 9.0, "beta": 1.0}},
        "dlm": {"tolerance": 0.4, "max_steps": 8, "window": 5},
        "me_greedy": {"least_mass": 0.2},
    }
    settings = experiment({"algorithm.window": 3}).model_dump(mode="json")
    settings_of_the_algorithm = experiment().algorithm.steps
    made = {
        name: build_method(type(experiment()).model_validate({**settings, "baselines": baselines}), name)
        for name in method_names()
    }
    assert isinstance(made["bics"], Bics)
    assert isinstance(made["bics"].memory, WindowMemory)
    assert made["bics"].memory.length == 3
    assert isinstance(made["ftl"], Ftl)
    assert (made["ftl"].tolerance, made["ftl"].max_steps, made["ftl"].steps) == (
        0.3,
        7,
        PaperSteps(alpha=9.0, beta=1.0),
    )
    assert isinstance(made["dlm"], Dlm)
    assert (made["dlm"].tolerance, made["dlm"].max_steps, made["dlm"].window) == (0.4, 8, 5)
    assert made["dlm"].steps == settings_of_the_algorithm
    assert isinstance(made["me_greedy"], MeGreedy)
    assert made["me_greedy"].least_mass == 0.2


def test_an_unknown_method_is_refused_by_name() -> None:
    with pytest.raises(ExperimentError, match="'genie' is none of the methods"):
        build_method(experiment(), "genie")


def test_central_methods_imitate_at_least_as_well_as_learners_alone() -> None:
    """On the same demonstrations, after the same iterations, exactly evaluated."""
    changes = {"algorithm.expectation": "exact", "game.horizon": 8, "algorithm.steps": {"alpha": 8.0, "beta": 4.0}}
    settings = experiment(changes)
    streams = demonstrations(settings)
    learners = simulate(settings, streams)
    game = build_method(settings, "me_greedy").game  # type: ignore[attr-defined]
    worst = min(
        exact_imitation(game, evaluation_policy(settings, name, game)(history[-1])).success_rate
        for name, history in learners.items()
    )
    for name in ("bics", "ftl", "dlm"):
        final = simulate_central(settings, name, streams)[name][-1]
        assert exact_imitation(game, evaluation_policy(settings, name, game)(final)).success_rate >= worst - 0.1
