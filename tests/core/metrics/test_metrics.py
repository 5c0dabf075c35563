"""Metrics by enumeration of every trajectory of a tiny game, by sampling, and by hand."""

from collections.abc import Callable, Sequence

import numpy as np
import pytest
from arenas import arena, double, random_rollouts
from games import (
    SlowPatrol,
    TablePolicy,
    all_trajectories,
    hallway,
    patrol,
    probabilities,
    random_policy,
)

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.metrics import drone_imitation, place_visitation, visitation_distance
from mabirds_core.games.interface import TabularGame, Trajectories
from mabirds_core.games.judging import ImitationMetrics
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.metrics.metrics import (
    consensus_distance,
    exact_imitation,
    norms,
    policy_distance,
    sampled_imitation,
)
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import SoftBellmanPolicy, soft_bellman_policy


def near(discount: float = 0.9, horizon: int = 2) -> PatrolGame:
    """hallway's map with goals that both experts can reach in two moves."""
    starts = [((0, 0), (0, 2)), ((0, 1), (1, 2))]
    return patrol("...\n.#.", starts, ((1, 0), (0, 1)), horizon, discount, probabilities=[0.4, 0.6])


def hurrying(game: TabularGame) -> SoftBellmanPolicy:
    """A soft policy that is drawn to the goal and somewhat afraid of constraints."""
    return soft_bellman_policy(game, 2 * game.task_reward - 1.5 * game.violation)


def enumerated_imitation(game: PatrolGame, policy: SoftBellmanPolicy | TablePolicy) -> ImitationMetrics:
    """CVR and SR trajectory by trajectory, with the slow rules."""
    slow, trajectories = SlowPatrol(game.settings), all_trajectories(game)
    violated = succeeded = 0.0
    chances = probabilities(game, policy, trajectories)
    for states, actions, chance in zip(*trajectories, chances, strict=True):
        pairs = [(slow.states[s], slow.actions[a]) for s, a in zip(states, actions, strict=True)]
        clean = not any(slow.violates(*pair) for pair in pairs)
        violated += chance * (not clean)
        succeeded += chance * (clean and slow.waiting(pairs[-1][0]) == 0)
    return ImitationMetrics(violated, succeeded)


@pytest.mark.parametrize("kind", ["hurrying", "random"])
def test_exact_imitation_is_that_over_all_trajectories(kind: str) -> None:
    game = near()
    policy = hurrying(game) if kind == "hurrying" else random_policy(game, np.random.default_rng(1))
    expected = enumerated_imitation(game, policy)
    assert 0 < expected.success_rate < 1 - expected.violation_rate < 1
    found = exact_imitation(game, policy)
    assert found.violation_rate == pytest.approx(expected.violation_rate, abs=1e-12)
    assert found.success_rate == pytest.approx(expected.success_rate, abs=1e-12)


def test_imitation_does_not_depend_on_the_discount() -> None:
    policy = hurrying(near())
    one, other = (exact_imitation(near(discount), policy) for discount in (0.5, 1.0))
    assert one == pytest.approx(other, abs=1e-15)


def test_sampled_imitation_approaches_the_exact_one() -> None:
    game, count = near(horizon=5), 10_000
    policy = hurrying(game)
    exact = exact_imitation(game, policy)
    sampled = sampled_imitation(game, rollouts(game, policy, count, np.random.default_rng(2)))
    for rate, estimate in zip(exact, sampled, strict=True):
        assert 0.05 < rate < 0.95
        assert abs(rate - estimate) <= 4.5 * np.sqrt(rate * (1 - rate) / count)


def test_a_policy_under_hard_constraints_violates_nothing_and_blocked_mass_is_no_success() -> None:
    game = near(horizon=4)
    reward = np.where(game.violation, -np.inf, 20 * game.task_reward)
    found = exact_imitation(game, soft_bellman_policy(game, reward))
    assert found.violation_rate == pytest.approx(0, abs=1e-12)
    assert found.success_rate == pytest.approx(1, abs=1e-6)


def test_rates_stay_within_zero_and_one_despite_rounding() -> None:
    game = near(horizon=59)
    for seed in range(10):
        noise = np.random.default_rng(seed).normal(scale=3, size=(game.n_states, game.n_actions))
        reward = np.where(game.violation, -np.inf, 100 * game.task_reward + noise)
        found = exact_imitation(game, soft_bellman_policy(game, reward))
        assert 0 <= found.violation_rate <= 1
        assert 0 <= found.success_rate <= 1


def test_sampled_imitation_by_hand() -> None:
    """Four trajectories of one expert below an obstacle: two are clean, and one of these arrives."""
    game = patrol(".#.\n...", [((1, 1),)], ((1, 0),), horizon=2)
    free, obstacle, goal, right = 4, 1, 3, 5
    states = [[free, goal, goal], [free, right, right], [free, obstacle, free], [obstacle, free, goal]]
    actions = [[3, 0, 0], [1, 1, 1], [0, 2, 2], [2, 3, 3]]
    found = sampled_imitation(game, Trajectories(np.array(states), np.array(actions)))
    assert found == ImitationMetrics(violation_rate=0.5, success_rate=0.25)


def test_a_swap_counts_as_violation_though_every_state_is_clean() -> None:
    game = patrol("..", [((0, 0), (0, 1))], ((0, 1), (0, 0)), horizon=1)
    swap, (start, swapped) = 1 * 4 + 3, (0 * 2 + 1, 1 * 2 + 0)
    found = sampled_imitation(game, Trajectories(np.array([[start, swapped]]), np.array([[swap, 0]])))
    assert found == ImitationMetrics(violation_rate=1.0, success_rate=0.0)


def test_consensus_distance_is_the_largest_distance_from_the_mean() -> None:
    vectors = [np.array([0.0, 0.0]), np.array([6.0, 8.0]), np.array([0.0, 1.0])]
    assert consensus_distance(vectors) == pytest.approx(np.hypot(6 - 2, 8 - 3))
    assert consensus_distance([np.array([3.0, 4.0]), np.array([3.0, 4.0])]) == 0
    assert consensus_distance([np.array([3.0, 4.0])]) == 0


def constant(game: TabularGame, chances: Sequence[float]) -> TablePolicy:
    """The same probabilities of the four moves everywhere and always, for one expert."""
    return TablePolicy(np.broadcast_to(chances, (game.horizon + 1, game.n_states, game.n_actions)))


def test_policy_distance_by_hand() -> None:
    """One expert in a corner that north and west do not leave: occupancies differ in the move alone."""
    game = patrol("...", [((0, 0),)], ((0, 2),), horizon=3)
    north, west, mostly_north = (
        constant(game, chances) for chances in ([1, 0, 0, 0], [0, 0, 0, 1], [0.75, 0, 0, 0.25])
    )
    assert policy_distance(game, [north, west]) == pytest.approx(1, abs=1e-15)
    assert policy_distance(game, [north, mostly_north]) == pytest.approx(0.25, abs=1e-15)
    assert policy_distance(game, [mostly_north, west, north]) == pytest.approx(1, abs=1e-15)


def test_policy_distance_weighs_later_steps_by_the_discount() -> None:
    """Policies that differ at the last of two steps only: their occupancies differ by gamma / (1 + gamma)."""
    game = patrol("...", [((0, 0),)], ((0, 2),), horizon=1, discount=0.5)
    north, turning = constant(game, [1, 0, 0, 0]), np.zeros((2, 3, 4))
    turning[0, :, 0] = turning[1, :, 3] = 1
    assert policy_distance(game, [north, TablePolicy(turning)]) == pytest.approx(0.5 / 1.5, abs=1e-15)


def test_policy_distance_of_equal_policies_is_zero() -> None:
    game = hallway()
    policy = random_policy(game, np.random.default_rng(3))
    assert policy_distance(game, [policy, policy, policy]) == 0
    assert policy_distance(game, [policy]) == 0


def test_norms_are_euclidean_and_named() -> None:
    assert norms(Parameters(np.array([3.0, -4.0]), np.array([2.0]))) == {"theta_norm": 5.0, "omega_norm": 2.0}


def test_drone_imitation_by_hand() -> None:
    """Past the obstacle to the goal region; through the obstacle to it; nowhere; through the obstacle and nowhere."""
    game = arena(1, {"drones.0.start": (0.3, 0.6), "drones.0.goal_region.centre": (1.3, 0.6), "horizon": 2})
    places = [
        [(0.3, 0.6), (0.7, 1.1), (1.3, 0.6)],
        [(0.3, 0.6), (0.9, 0.6), (1.3, 0.6)],
        [(0.3, 0.6), (0.3, 0.7), (0.3, 0.8)],
        [(0.3, 0.6), (0.8, 0.6), (0.3, 0.6)],
    ]
    found = drone_imitation(game, Trajectories(np.array(places), np.zeros((4, 3, 2))))
    assert found == ImitationMetrics(violation_rate=0.5, success_rate=0.25)


@pytest.mark.parametrize("make", [arena, double])
@pytest.mark.parametrize("spacing", [0.1, 0.5, 1000.0])
def test_each_drone_spends_all_of_its_time_somewhere(make: Callable[..., DroneGame], spacing: float) -> None:
    game = make(3)
    found = place_visitation(game, random_rollouts(game, 20), spacing)
    assert found.shape == (3, *(count - 1 for count in game.settings.lattice(spacing)))
    assert found.min() >= 0
    np.testing.assert_allclose(found.sum(axis=(1, 2)), 1, rtol=0, atol=1e-12)


def test_place_visitation_by_hand() -> None:
    """Two rollouts of three steps, gamma = 1/2, squares of 0.8 m by 0.6 m; the far walls belong to the last ones."""
    game = arena(1, {"discount": 0.5, "horizon": 2})
    places = [[(0.0, 0.0), (0.79, 0.59), (0.81, 0.59)], [(1.6, 1.2), (1.6, 0.0), (0.0, 1.2)]]
    found = place_visitation(game, Trajectories(np.array(places), np.zeros((2, 3, 2))), spacing=0.8)
    one, two, three = np.array([1, 0.5, 0.25]) / 1.75 / 2
    np.testing.assert_allclose(found, [[[one + two, three], [three + two, one]]], rtol=0, atol=1e-15)


def test_drones_are_counted_each_for_itself() -> None:
    both, alone = arena(2), arena(1)
    rollouts = random_rollouts(both, 10)
    own = place_visitation(alone, Trajectories(rollouts.states[..., :2], rollouts.actions[..., :2]))
    np.testing.assert_allclose(place_visitation(both, rollouts)[:1], own, rtol=0, atol=1e-15)


def test_rollout_distance_is_between_zero_and_one() -> None:
    """Equal visitations; one drone of two elsewhere; both elsewhere; a quarter of the time of one."""
    here, there = np.array([[1.0, 0.0]]), np.array([[0.0, 1.0]])
    both = np.stack([here, here])
    assert visitation_distance([both]) == visitation_distance([both, both, both]) == 0
    assert visitation_distance([both, np.stack([here, there])]) == 0.5
    assert visitation_distance([both, both, np.stack([there, there])]) == 1
    assert visitation_distance([both, np.stack([here, 0.75 * here + 0.25 * there])]) == pytest.approx(0.125)
