"""Soft Q-learning against the exact policy, against a slow re-computation, and from one search to the next."""

from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from experiments import demonstrations, experiment
from games import alone, hallway, patrol, random_policy, square, trio

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Indices
from mabirds_core.experiment.assembly import build_game, build_learner, build_reward
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.metrics.metrics import exact_imitation, policy_distance
from mabirds_core.planners.interface import Policy
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner
from mabirds_core.planners.soft_q_learning import ExploringPolicy, SoftQPlanner, SoftQPolicy, backed_up
from mabirds_core.rewards.models import LinearReward

pytestmark = pytest.mark.filterwarnings("error")

Build = Callable[[], PatrolGame]


def building() -> PatrolGame:
    """4x4 cells with two obstacles, two experts that swap corners: S = 256, A = 16, T = 12."""
    return patrol("....\n.##.\n....\n....", [((0, 0), (3, 3))], ((3, 3), (0, 0)), horizon=12, discount=0.95)


def long_hallway() -> PatrolGame:
    return hallway(horizon=6)


GAMES = [square, hallway, long_hallway, trio, alone, building]
every_game = pytest.mark.parametrize("build", GAMES, ids=lambda build: build.__name__)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def learning(game: PatrolGame, episodes: int = 200, sweeps: int = 4, exploration: float = 0.3) -> SoftQPlanner:
    model = LinearReward(game.reward_features)
    return SoftQPlanner(game, model, game.cost_features, episodes, sweeps, exploration)


def exact(game: PatrolGame) -> SoftBellmanPlanner:
    return SoftBellmanPlanner(game, LinearReward(game.reward_features), game.cost_features)


def random_parameters(game: PatrolGame, seed: int = 0, scale: float = 1.0) -> Parameters:
    draw = rng(seed).normal
    sizes = len(game.reward_features.names), len(game.cost_features.names)
    return Parameters(*(draw(scale=scale, size=size) for size in sizes))


def nearby(parameters: Parameters, seed: int, scale: float) -> Parameters:
    draw = rng(seed).normal
    return Parameters(*(part + draw(scale=scale, size=len(part)) for part in parameters))


def visited(policy: SoftQPolicy) -> Indices:
    return policy.visited[:-1]


def reachable(game: PatrolGame) -> set[int]:
    """States in which an episode can be at t = 0..T."""
    states = set(np.flatnonzero(game.initial_distribution).tolist())
    for _ in range(game.horizon):
        states |= set(game.successor[sorted(states)].ravel().tolist())
    return states


def seen_to_the_end(game: PatrolGame, policy: SoftQPolicy) -> Array:
    """[t, i]: has every state been visited that can be reached from the i-th visited state at t?"""
    known = np.isin(np.arange(game.n_states), visited(policy))
    whole = [known]
    for _ in range(game.horizon):
        whole.append(known & whole[-1][game.successor].all(axis=1))
    return np.stack(whole[::-1])[:, visited(policy)]


def assert_same_bits(one: SoftQPolicy, other: SoftQPolicy) -> None:
    assert one.visited.tobytes() == other.visited.tobytes()
    assert one.values.tobytes() == other.values.tobytes()
    assert one.reward.tobytes() == other.reward.tobytes()


def assert_normalised(game: PatrolGame, policy: Policy) -> None:
    for step in range(game.horizon + 1):
        rows = policy.log_probabilities(step, np.arange(game.n_states))
        assert rows.shape == (game.n_states, game.n_actions)
        assert np.isfinite(rows).all()
        np.testing.assert_allclose(np.exp(rows).sum(axis=1), 1, rtol=0, atol=1e-12)


@every_game
@pytest.mark.parametrize("scale", [0.1, 1.0, 3.0])
@pytest.mark.parametrize("seed", range(3))
def test_the_policy_is_that_of_exact_soft_value_iteration_within_a_hundredth(
    build: Build, scale: float, seed: int
) -> None:
    game = build()
    parameters = random_parameters(game, seed, scale)
    found = learning(game).plan(*parameters, rng=rng(seed))
    assert policy_distance(game, [found, exact(game).plan(*parameters)]) < 0.01


@pytest.mark.parametrize("build", [square, long_hallway, alone, building], ids=lambda build: build.__name__)
@pytest.mark.parametrize("episodes", [1000, 20])
def test_values_are_exact_wherever_only_visited_states_can_be_reached(build: Build, episodes: int) -> None:
    game = build()
    parameters = random_parameters(game, scale=0.1)
    policy = learning(game, episodes).plan(*parameters, rng=rng())
    whole, exact_values = seen_to_the_end(game, policy), exact(game).plan(*parameters).values[:-1, visited(policy)]
    assert whole.mean() > 0.1
    np.testing.assert_allclose(policy.values[:-1, :-1][whole], exact_values[whole], rtol=0, atol=1e-9)
    if episodes == 1000:
        assert set(visited(policy).tolist()) == reachable(game)
        assert whole[0, np.isin(visited(policy), np.flatnonzero(game.initial_distribution))].all()


class SlowValues:
    """The backups once more, one number at a time."""

    def __init__(self, game: PatrolGame, reward: Array, states: set[int]) -> None:
        self.game, self.reward, self.states = game, reward, states
        self.value = cache(self._value)

    def q(self, step: int, state: int) -> Array:
        """Q_t(s, a), shape (A,); an unvisited successor is worth the best visited one, or s itself."""
        successors = self.game.successor[state].tolist()
        best = max((self.value(step + 1, near) for near in {*successors, state} & self.states), default=0.0)
        ahead = [self.value(step + 1, after) if after in self.states else best for after in successors]
        return self.reward[state] + self.game.discount * np.array(ahead)

    def _value(self, step: int, state: int) -> float:
        return float(np.log(np.exp(self.q(step, state)).sum())) if step <= self.game.horizon else 0.0


@every_game
@pytest.mark.parametrize("share", [0.1, 0.5])
def test_policies_of_any_visited_states_are_those_of_the_slow_recomputation(build: Build, share: float) -> None:
    game = build()
    reward = rng(1).normal(size=(game.n_states, game.n_actions))
    chosen = np.flatnonzero(rng(2).random(game.n_states) < share)
    policy = backed_up(game, reward, np.append(chosen, game.n_states))
    slow = SlowValues(game, reward, set(chosen.tolist()))
    for step in (0, game.horizon - 1, game.horizon):
        expected = [slow.value(step, state) for state in chosen.tolist()]
        np.testing.assert_allclose(policy.values[step, :-1], expected, rtol=0, atol=1e-12)
        q = np.array([slow.q(step, state) for state in range(game.n_states)])
        expected_rows = q - np.log(np.exp(q).sum(axis=1, keepdims=True))
        found = policy.log_probabilities(step, np.arange(game.n_states))
        np.testing.assert_allclose(found, expected_rows, rtol=0, atol=1e-12)


@every_game
def test_probabilities_are_finite_and_sum_to_one_in_visited_and_unvisited_states(build: Build) -> None:
    game = build()
    policy = learning(game, episodes=1, sweeps=1).plan(*random_parameters(game), rng=rng())
    assert 0 < len(visited(policy)) < game.n_states
    assert_normalised(game, policy)


@pytest.mark.parametrize("scale", [1e4, 1e99])
def test_very_large_parameters_neither_overflow_nor_vanish(scale: float) -> None:
    game = hallway()
    policy = learning(game, episodes=10, exploration=0.0).plan(*random_parameters(game, scale=scale), rng=rng())
    assert_normalised(game, policy)


@pytest.mark.parametrize("size", [1e15, -1e99])
def test_equal_rewards_of_any_size_leave_actions_uniform(size: float) -> None:
    game = hallway()
    alike = Parameters(np.full(len(game.reward_features.names), size), np.zeros(len(game.cost_features.names)))
    policy = learning(game).plan(*alike, rng=rng())
    rows = policy.log_probabilities(0, visited(policy))
    np.testing.assert_allclose(rows, -np.log(game.n_actions), rtol=0, atol=1e-12)


def test_where_nothing_was_visited_the_reward_alone_decides() -> None:
    game = hallway()
    reward = rng().normal(size=(game.n_states, game.n_actions))
    expected = reward - np.log(np.exp(reward).sum(axis=1, keepdims=True))
    found = backed_up(game, reward, np.array([game.n_states])).log_probabilities(1, np.arange(game.n_states))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("shift", [-3.0, 50.0])
def test_a_constant_reward_changes_neither_the_search_nor_its_policy(shift: float) -> None:
    game = building()
    plain = random_parameters(game)
    shifted = plain._replace(theta=plain.theta + shift / game.n_experts)
    one, other = (learning(game, episodes=10, sweeps=3).plan(*parameters, rng=rng()) for parameters in (plain, shifted))
    np.testing.assert_array_equal(one.visited, other.visited)
    gained = shift * np.array([sum(0.95**k for k in range(steps)) for steps in range(13, -1, -1)])
    np.testing.assert_allclose(other.values[:, :-1], one.values[:, :-1] + gained[:, None], rtol=0, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_from_a_policy_of_nearby_parameters_few_episodes_come_closer_than_from_nothing(seed: int) -> None:
    game = building()
    before = random_parameters(game, seed, scale=0.3)
    after = nearby(before, seed + 100, scale=0.03)
    previous, few = learning(game).plan(*before, rng=rng(seed)), learning(game, episodes=10, sweeps=1)
    truth = exact(game).plan(*after)
    warm, cold = (policy_distance(game, [few.plan(*after, start, rng(seed)), truth]) for start in (previous, None))
    assert warm < 0.01
    assert cold > 0.1


def test_values_of_earlier_parameters_leave_no_trace() -> None:
    game = long_hallway()
    now = random_parameters(game, 1)
    opposite = learning(game, exploration=1.0).plan(-3 * now.theta, -3 * now.omega, rng=rng())
    found = learning(game, episodes=1, sweeps=1).plan(*now, opposite, rng())
    assert policy_distance(game, [found, exact(game).plan(*now)]) < 1e-9


def test_two_sweeps_are_two_searches_of_one_sweep_the_second_from_the_first() -> None:
    game, parameters, draws = building(), random_parameters(building()), rng()
    first = learning(game, episodes=5, sweeps=1).plan(*parameters, rng=draws)
    second = learning(game, episodes=5, sweeps=1).plan(*parameters, first, draws)
    assert_same_bits(learning(game, episodes=5, sweeps=2).plan(*parameters, rng=rng()), second)


def test_a_search_is_decided_by_its_arguments_and_not_by_earlier_searches() -> None:
    game = building()
    planner, before, after = learning(game, episodes=10), random_parameters(game, 0), random_parameters(game, 1)
    previous = planner.plan(*before, rng=rng())
    first = planner.plan(*after, previous, rng(1))
    planner.plan(*before, first, rng(2))
    assert_same_bits(planner.plan(*after, previous, rng(1)), first)
    other = planner.plan(*after, previous, rng(3))
    assert other.visited.tobytes() != first.visited.tobytes()


def test_a_search_leaves_what_it_starts_from_as_it_was() -> None:
    game = building()
    planner, parameters = learning(game, episodes=10), random_parameters(game)
    previous, same = (planner.plan(*parameters, rng=rng()) for _ in range(2))
    planner.plan(*parameters, previous, rng(1))
    assert_same_bits(previous, same)
    np.testing.assert_array_equal(parameters.theta, random_parameters(game).theta)
    np.testing.assert_array_equal(parameters.omega, random_parameters(game).omega)


def test_a_previous_policy_of_another_kind_or_game_is_a_fresh_start() -> None:
    game, parameters = building(), random_parameters(building())
    planner = learning(game, episodes=5, sweeps=1)
    longer = patrol("....\n.##.\n....\n....", [((0, 0), (3, 3))], ((3, 3), (0, 0)), horizon=20, discount=0.95)
    fresh = planner.plan(*parameters, rng=rng())
    for other in (exact(game).plan(*parameters), learning(longer).plan(*parameters, rng=rng())):
        assert_same_bits(planner.plan(*parameters, other, rng()), fresh)
    same_game = learning(building(), episodes=5, sweeps=1).plan(*parameters, rng=rng(8))
    assert set(same_game.visited.tolist()) < set(planner.plan(*parameters, same_game, rng()).visited.tolist())


def test_without_a_generator_a_search_is_refused() -> None:
    game = square()
    with pytest.raises(TypeError, match=r"rng is None; pass a numpy.random.Generator"):
        learning(game).plan(*random_parameters(game))


class Watched:
    """The successor table of a game, noting of which states it was asked."""

    def __init__(self, table: Indices) -> None:
        self.table, self.asked = table, set[int]()

    def __getitem__(self, key: Any) -> Indices:
        states = key[0] if isinstance(key, tuple) else key
        self.asked |= set(np.asarray(states).ravel().tolist())
        return self.table[key]


def test_the_simulator_is_asked_only_in_states_that_episodes_meet() -> None:
    game = building()
    watched = Watched(game.successor)
    game.grid.__dict__["successor"] = watched
    policy = learning(game, episodes=3, sweeps=2).plan(*random_parameters(game), rng=rng())
    assert watched.asked == set(visited(policy).tolist())
    assert len(watched.asked) < game.n_states / 2


def test_memory_grows_with_visited_states_only() -> None:
    game, sizes, policy = building(), [0], None
    for seed in range(4):
        policy = learning(game, episodes=2, sweeps=1).plan(*random_parameters(game), policy, rng(seed))
        sizes.append(len(visited(policy)))
        assert policy.values.shape == (game.horizon + 2, sizes[-1] + 1)
    assert all(0 <= more - less <= 2 * (game.horizon + 1) for less, more in pairwise(sizes))
    assert 0 < sizes[1] < sizes[-1] < game.n_states


def test_exploration_mixes_the_policy_with_uniform_actions() -> None:
    game = hallway()
    policy, states = random_policy(game, rng()), np.arange(game.n_states)
    own = np.exp(policy.log_probabilities(1, states))
    for share in (0.0, 0.25, 1.0):
        mixed = np.exp(ExploringPolicy(policy, share).log_probabilities(1, states))
        np.testing.assert_allclose(mixed, (1 - share) * own + share / 16, rtol=0, atol=1e-15)


def test_exploration_finds_what_the_policy_alone_would_not() -> None:
    """Paid for staying where it is, an expert goes nowhere else of its own accord."""
    game = patrol("......", [((0, 0),)], ((0, 5),), horizon=10)
    theta, omega = np.full(len(game.reward_features.names), -1.0), np.zeros(len(game.cost_features.names))
    theta[3] = 100.0  # west of the first cell is the wall
    shy, bold = (learning(game, 20, exploration=share).plan(theta, omega, rng=rng()) for share in (0.0, 0.5))
    assert len(visited(shy)) <= 2 < len(visited(bold))


LEARNED = {"kind": "soft_q_learning", "episodes": 20, "sweeps": 2, "exploration": 0.2}


def test_learners_learn_by_it_what_they_learn_by_exact_policies() -> None:
    changes: dict[str, Any] = {"algorithm.expectation": "exact"}
    settings = [experiment(changes), experiment({**changes, "algorithm.policy": LEARNED})]
    game, streams = build_game(settings[0]), demonstrations(settings[0])
    histories = [simulate(one, streams) for one in settings]
    truth = SoftBellmanPlanner(game, build_reward(settings[0], game), game.cost_features)
    for name in settings[0].learners:
        by_exact, by_learning = (truth.plan(*history[name][-1]) for history in histories)
        first = truth.plan(*histories[1][name][0])
        assert policy_distance(game, [by_exact, by_learning]) < 0.01
        assert exact_imitation(game, first).violation_rate > 0.7
        assert exact_imitation(game, by_learning).violation_rate < 0.2


def test_a_learner_starts_every_search_from_the_one_before() -> None:
    settings = experiment({"algorithm.policy": {**LEARNED, "episodes": 1, "sweeps": 1}, "schedule.kind": "alternating"})
    learner = build_learner(settings, "ann")
    assert isinstance(learner.estimator.planner, SoftQPlanner)
    state, known = learner.initial_state(), [set[int]()]
    for n, demonstration in enumerate(demonstrations(settings)["ann"], start=1):
        neighbours = dict.fromkeys(learner.mixer.schedule.senders_to("ann", n), state.parameters)
        state = learner.step(state, demonstration, neighbours).state
        assert isinstance(state.policy, SoftQPolicy)
        known.append(set(visited(state.policy).tolist()))
    assert all(fewer <= more for fewer, more in pairwise(known))
    assert len(known[-1]) > settings.game.horizon + 1
