"""Moves that slip, against enumeration: policies, expectations, rates, constraint tests, experts; and slip 0."""

from itertools import product

import numpy as np
import pytest
from experiments import experiment
from games import SlowPatrol, central_differences, patrol, random_policy, slippery
from pydantic import ValidationError
from scipy.special import logsumexp

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Mask, Vector
from mabirds_core.errors import ExperimentError, ImpossibleTrajectoryError
from mabirds_core.experiment.assembly import build_method
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.tabular.constraint_test import touch_probability
from mabirds_core.games.tabular.experts import OptimalExperts, SoftExperts
from mabirds_core.games.tabular.transitions import Deterministic, Slipping
from mabirds_core.metrics.metrics import exact_imitation, sampled_imitation
from mabirds_core.planners.interface import TabularPolicy
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, rollouts
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner, SoftBellmanPolicy, soft_bellman_policy

GAMES = {
    "two who wait": slippery(),
    "one": patrol("..\n.#\n..", [((0, 0),)], [(2, 0)], 3, slip=0.25),
    "three": patrol("...", [((0, 0), (0, 1), (0, 2))], [(0, 1), (0, 2), (0, 0)], 1, slip=0.5),
    "diagonal, leaving": patrol(
        "..\n..", [((0, 0), (1, 1))], [((0, 1), (1, 1)), ((0, 1),)], 2, diagonals=True, leaving=True, slip=0.1
    ),
}
every_game = pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)


def transition(game: PatrolGame) -> Array:
    """P[s, a, s'], by loops over who makes which move instead of the one that was chosen."""
    rules, slip = SlowPatrol(game.settings), game.settings.slip
    index = {state: number for number, state in enumerate(rules.states)}
    chances = np.zeros((len(rules.states), len(rules.actions), len(rules.states)))
    moves = range(len(rules.steps))
    for (s, state), (a, action) in product(enumerate(rules.states), enumerate(rules.actions)):
        for made in product(moves, repeat=len(state)):
            of_each = [slip / len(moves) + (1 - slip) * (m == chosen) for m, chosen in zip(made, action, strict=True)]
            chances[s, a, index[rules.after(state, made)]] += np.prod(of_each)
    return chances


DENSE = {id(game): transition(game) for game in GAMES.values()}


def drawn(game: PatrolGame, seed: int = 0) -> tuple[Vector, Vector]:
    rng = np.random.default_rng(seed)
    return rng.normal(size=len(game.reward_features.names)), -rng.exponential(size=len(game.cost_features.names))


def table(game: PatrolGame, theta: Vector, omega: Vector) -> Array:
    return game.reward_features.table(theta) + game.cost_features.table(omega)


def slow_values(game: PatrolGame, reward: Array) -> Array:
    """V[t, s] of the causal-entropy soft Bellman equation, with the whole P(s' | s, a) and scipy."""
    values = np.zeros((game.horizon + 2, game.n_states))
    for step in reversed(range(game.horizon + 1)):
        values[step] = logsumexp(reward + game.discount * DENSE[id(game)] @ values[step + 1], axis=1)
    return values


def planned(game: PatrolGame, theta: Vector, omega: Vector) -> SoftBellmanPolicy:
    policy = SoftBellmanPlanner(game, game.linear_reward(), game.cost_features).plan(theta, omega)
    assert isinstance(policy, SoftBellmanPolicy)
    return policy


@every_game
def test_transitions_are_those_of_experts_who_slip_each_for_itself(game: PatrolGame) -> None:
    rng, dense = np.random.default_rng(0), DENSE[id(game)]
    np.testing.assert_allclose(dense.sum(axis=2), 1, rtol=0, atol=1e-12)
    values, pairs = rng.normal(size=game.n_states), rng.random((game.n_states, game.n_actions))
    some = rng.permutation(game.n_states)[:3]
    for states in (slice(None), some):
        np.testing.assert_allclose(game.transitions.expected(values, states), dense[states] @ values, atol=1e-12)
        np.testing.assert_allclose(
            game.transitions.onward(pairs[states], states),
            np.einsum("sa,sat->t", pairs[states], dense[states]),
            atol=1e-12,
        )


@every_game
def test_the_policy_is_that_of_the_soft_bellman_equation(game: PatrolGame) -> None:
    theta, omega = drawn(game)
    policy, expected = planned(game, theta, omega), slow_values(game, table(game, theta, omega))
    np.testing.assert_allclose(policy.values, expected, rtol=0, atol=1e-12)
    chances = np.exp(policy.log_probabilities(0, np.arange(game.n_states)))
    np.testing.assert_allclose(chances.sum(axis=1), 1, rtol=0, atol=1e-12)


def test_no_policy_has_more_reward_and_causal_entropy() -> None:
    """V_0 is the largest soft return over policies: random ones and small changes of the best one earn less."""
    game = GAMES["one"]
    theta, omega = drawn(game)
    reward = table(game, theta, omega)
    best, rng = planned(game, theta, omega), np.random.default_rng(1)
    found = soft_return(game, reward, best)
    assert found == pytest.approx(float(game.initial_distribution @ best.values[0]), abs=1e-12)
    for _ in range(20):
        assert soft_return(game, reward, random_policy(game, rng)) < found
        nearby = SoftBellmanPolicy(game, reward, best.values + 0.1 * rng.normal(size=best.values.shape), game.discount)
        assert soft_return(game, reward, Renormalised(nearby)) < found


class Renormalised:
    """A policy whose chances are made to sum to 1."""

    def __init__(self, policy: TabularPolicy) -> None:
        self.policy = policy

    def log_probabilities(self, step: int, states: Array) -> Array:
        logs = self.policy.log_probabilities(step, states)
        return logs - logsumexp(logs, axis=1, keepdims=True)


def soft_return(game: PatrolGame, reward: Array, policy: TabularPolicy) -> float:
    """E sum_t gamma^t (r - log pi), forwards with the whole P(s' | s, a)."""
    present, total = game.initial_distribution, 0.0
    for step in range(game.horizon + 1):
        logs = policy.log_probabilities(step, np.arange(game.n_states))
        pairs = present[:, None] * np.exp(logs)
        total += game.discount**step * float((pairs * (reward - logs)).sum())
        present = np.einsum("sa,sat->t", pairs, DENSE[id(game)])
    return total


@every_game
def test_expectations_are_the_gradient_of_the_value(game: PatrolGame) -> None:
    theta, omega = drawn(game, 2)
    visits = game.expectation("exact", 0)(planned(game, theta, omega), np.random.default_rng(0))

    def value(both: Vector) -> float:
        reward = table(game, both[: len(theta)], both[len(theta) :])
        return float(game.initial_distribution @ slow_values(game, reward)[0])

    expected = central_differences(value, np.concatenate([theta, omega]))
    found = np.concatenate([game.reward_features.total(visits), game.cost_features.total(visits)])
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-7)


def test_rollouts_visit_what_the_occupancy_says() -> None:
    game = GAMES["two who wait"]
    theta, omega = drawn(game, 3)
    policy, count = planned(game, theta, omega), 40_000
    exact = discounted_steps(game) * occupancy_measure(game, policy)
    sampled = game.expectation("sampled", count)(policy, np.random.default_rng(0))
    seen = np.zeros_like(exact)
    np.add.at(seen, (sampled.states, sampled.actions), sampled.weights)
    np.testing.assert_allclose(seen, exact, rtol=0, atol=5 * np.sqrt(discounted_steps(game) / count) / 2)


def test_what_is_drawn_follows_as_often_as_it_should() -> None:
    game, rng, count = GAMES["two who wait"], np.random.default_rng(4), 60_000
    for state, action in ((0, 7), (6, 24), (9, 11)):
        after = game.transitions.draw(np.full(count, state), np.full(count, action), rng)
        shares = np.bincount(after, minlength=game.n_states) / count
        np.testing.assert_allclose(shares, DENSE[id(game)][state, action], rtol=0, atol=0.01)


@every_game
def test_rates_are_those_of_all_trajectories(game: PatrolGame) -> None:
    policy = random_policy(game, np.random.default_rng(5))
    kept, reached = chance_of_keeping(game, policy, game.violation)
    assert exact_imitation(game, policy) == pytest.approx((1 - kept, reached), abs=1e-12)


def chance_of_keeping(game: PatrolGame, policy: TabularPolicy, touched: Mask) -> tuple[float, float]:
    """Probability of never having a pair ``touched``, and of that with all at the goal at T: by recursion."""

    def onward(step: int, state: int) -> Vector:
        chances = np.exp(policy.log_probabilities(step, np.array([state])))[0]
        total = np.zeros(2)
        for action in np.flatnonzero(~touched[state]):
            if step == game.horizon:
                total += chances[action] * np.array([1.0, game.goal[state]])
                continue
            for after in np.flatnonzero(DENSE[id(game)][state, action]):
                total += chances[action] * DENSE[id(game)][state, action, after] * known[step + 1][after]
        return total

    known: dict[int, dict[int, Vector]] = {}
    for step in reversed(range(game.horizon + 1)):
        known[step] = {state: onward(step, state) for state in range(game.n_states)}
    kept, reached = sum((game.initial_distribution[s] * known[0][s] for s in range(game.n_states)), np.zeros(2))
    return float(kept), float(reached)


def test_rates_of_rollouts_are_near_the_exact_ones() -> None:
    game = GAMES["one"]
    policy = random_policy(game, np.random.default_rng(6))
    shown = rollouts(game, policy, 20_000, np.random.default_rng(7))
    assert sampled_imitation(game, shown) == pytest.approx(exact_imitation(game, policy), abs=0.02)


@every_game
def test_the_chance_of_touching_is_that_of_all_trajectories(game: PatrolGame) -> None:
    theta, omega = drawn(game, 8)
    reward = table(game, theta, omega)
    touched = np.random.default_rng(9).random(reward.shape) < 0.2
    expected = 1 - chance_of_keeping(game, soft_bellman_policy(game, reward), touched)[0]
    assert touch_probability(game, reward, touched) == pytest.approx(expected, abs=1e-12)


def test_a_neutral_cell_is_neutral_for_moves_that_slip() -> None:
    """A reward of rho + Phi(c) - gamma E Phi(c') has nothing to change at any cell."""
    game = patrol("....\n....\n....", [((0, 0),)], [(2, 3)], 6, 0.9, slip=0.3)
    rng, n = np.random.default_rng(10), game.n_cells
    potential = rng.normal(size=n)
    potential[-1] = 0.0
    dense = transition(game)
    rewards = (-0.5 + potential[:, None] - game.discount * dense @ potential).ravel()
    made = np.full((n, 4), 0.5)
    made[5] = 0.0
    change = game.neutral_change(rewards, np.zeros(len(game.cost_features.names)), made.ravel(), 5)
    assert isinstance(change, Parameters)
    moved = np.flatnonzero(np.abs(change.theta) > 1e-9)
    into, out = (game.expert_successor[0] == 5).ravel(), np.arange(4 * n) // 4 == 5
    assert set(moved) <= set(np.flatnonzero(into | out))  # Phi(5) becomes the mean of its neighbours', and no other


def test_soft_experts_follow_the_policy_of_a_finite_cost() -> None:
    game = slippery(horizon=6)
    DENSE[id(game)] = transition(game)
    reward = np.where(game.violation, game.task_reward - 20.0, game.task_reward)
    late = np.where(game.goal, 0.0, 20.0)
    after, experts, everywhere = np.zeros(game.n_states), SoftExperts(game), np.arange(game.n_states)
    for step in (6, 5, 4, 3, 2, 1, 0):
        q = reward - late[:, None] * (step == 6) + DENSE[id(game)] @ after
        after = logsumexp(q, axis=1)
        np.testing.assert_allclose(experts.values[step], after, rtol=0, atol=1e-10)
        logs = experts.log_probabilities(step, everywhere)
        np.testing.assert_allclose(logs, q - after[:, None], rtol=0, atol=1e-10)


def test_optimal_experts_earn_the_most_on_average() -> None:
    game = slippery(horizon=4)
    reward, dense = np.where(game.violation, game.task_reward - 20.0, game.task_reward), transition(game)
    values = np.zeros(game.n_states)
    for step in (4, 3, 2, 1, 0):
        values = (reward + dense @ values).max(axis=1) - 20.0 * (step == 4) * ~game.goal
    np.testing.assert_allclose(OptimalExperts(game).values[0], values, rtol=0, atol=1e-10)


def test_demonstrations_are_read_again_although_moves_slipped() -> None:
    game = slippery(0.6, horizon=8)
    slips = 0
    for demonstration in game.experts("soft", "by_start").demonstrations(20, np.random.default_rng(0)):
        states, actions = game.encode(demonstration)
        np.testing.assert_array_equal(game.decode(states, actions).states, demonstration.states)
        chosen = game.successor[demonstration.states[0, :-1], demonstration.actions[0, :-1]]
        slips += int((chosen != demonstration.states[0, 1:]).sum())
    assert slips > 20


def test_nobody_slips_where_no_move_leads() -> None:
    game = slippery(horizon=2)
    states, actions = np.zeros((3, 4)), np.zeros((3, 2))
    states[1:, :2] = 1.0  # diagonally, which no move does
    with pytest.raises(ImpossibleTrajectoryError, match="step 0: expert 1 moves north from .* and what lies beside"):
        game.decode(states, actions)


def test_slip_0_is_the_deterministic_game_bit_for_bit() -> None:
    never, plain = slippery(0.0, 5), patrol("..\n.#", [((0, 0), (1, 0))], [(1, 0), (0, 1)], 5, 0.8, waiting=True)
    assert never.digest == plain.digest
    assert isinstance(never.transitions, Deterministic)
    rewards = drawn(plain)
    found = [
        SoftBellmanPlanner(game, game.linear_reward(), game.cost_features).plan(*rewards) for game in (never, plain)
    ]
    np.testing.assert_array_equal(*(policy.values for policy in found))
    shown = [rollouts(plain, policy, 9, np.random.default_rng(3)) for policy in found]
    np.testing.assert_array_equal(*(np.stack(of) for of in shown))


def test_the_arithmetic_of_slips_is_exact_at_slip_0() -> None:
    plain = slippery(0.0, 5)
    never = slippery(0.0, 5)
    chosen = Deterministic(lambda: never.successor)
    never.__dict__["transitions"] = Slipping(chosen, never.n_experts, never.n_moves, 0.0)
    reward = table(plain, *drawn(plain))
    ours, theirs = (soft_bellman_policy(game, reward) for game in (plain, never))
    np.testing.assert_array_equal(ours.values, theirs.values)
    np.testing.assert_array_equal(*(occupancy_measure(of.game, of) for of in (ours, theirs)))
    np.testing.assert_array_equal(*(np.array(exact_imitation(of.game, of)) for of in (ours, theirs)))


def test_as_the_slip_goes_to_0_so_does_the_difference() -> None:
    game = slippery(0.0, 5)
    least = PatrolGame(game.settings.model_copy(update={"slip": 1e-12}))
    assert isinstance(least.transitions, Slipping)
    reward = table(game, *drawn(game))
    ours, theirs = (soft_bellman_policy(of, reward).values for of in (game, least))
    np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-9)


def test_a_trajectory_of_all_slips_is_a_random_walk() -> None:
    """With a slip near 1 actions decide nothing."""
    game = slippery(1 - 1e-12)
    after = game.transitions.expected(np.arange(game.n_states, dtype=float), slice(None))
    np.testing.assert_allclose(after, after[:, :1] + np.zeros_like(after), rtol=0, atol=1e-9)


def test_the_likelihood_is_that_of_what_was_chosen() -> None:
    game = slippery()
    policy = planned(game, *drawn(game))
    shown = Trajectories(np.array([[2, 2, 2]]), np.array([[4, 4, 4]]))
    logs = [policy.log_probabilities(t, np.array([2]))[0, 4] for t in range(3)]
    assert game.judge.log_likelihoods(policy, shown)[0] == pytest.approx(sum(logs))


def test_what_knows_no_chance_refuses_moves_that_slip() -> None:
    with pytest.raises(ValidationError, match="soft_q_learning: moves slip; take soft_value_iteration"):
        experiment({"game.slip": 0.1, "algorithm.policy": {"kind": "soft_q_learning"}})
    with pytest.raises(ExperimentError, match="me_greedy: moves slip, and hard constraints cannot be kept"):
        build_method(experiment({"game.slip": 0.1}), "me_greedy")
