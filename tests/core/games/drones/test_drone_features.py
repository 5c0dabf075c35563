"""Features of the drone game against their formulas, written once more pair by pair."""

from collections.abc import Callable

import numpy as np
import pytest
from arenas import SlowArena, arena, double, random_rollouts

from mabirds_core.arrays import Array, Vector
from mabirds_core.games.drones.features import DroneReward, RbfGrid, total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.interface import Visitation, discounted_visitation

every_game = pytest.mark.parametrize("drones", [1, 2, 3])
make_either = pytest.mark.parametrize("make", [arena, double])


def some_visitation(game: DroneGame, seed: int = 0) -> Visitation:
    """Pairs of random rollouts with weights of either sign."""
    states, actions, _ = discounted_visitation(random_rollouts(game, 8, seed), game.discount)
    return Visitation(states, actions, np.random.default_rng(seed).normal(size=len(states)))


def slow_costs(game: DroneGame, state: Vector, action: Vector) -> list[float]:
    """phi(s, a): place RBFs drone by drone, distance RBFs pair by pair, efforts."""
    slow, longest = SlowArena(game.settings), game.dynamics.max_action
    places, controls = game.positions(state).tolist(), game.controls(action).tolist()
    return [
        *(cost for i, place in enumerate(places) for cost in slow.place_costs(i, place)),
        *(
            cost
            for i, j in game.pairs
            for cost in slow.distance_costs(float(np.hypot(*np.subtract(places[i], places[j]))))
        ),
        *(slow.effort(control, longest) for control in controls),
    ]


def slow_rewards(game: DroneGame, state: Vector, action: Vector) -> list[float]:
    """f(s, a): place RBFs drone by drone."""
    slow = SlowArena(game.settings)
    return [value for place in game.positions(state).tolist() for value in slow.place_rewards(place)]


def table(game: DroneGame, visitation: Visitation, slow: Callable[..., list[float]]) -> Array:
    """Every feature of every pair, shape (M, K)."""
    return np.array([slow(game, *pair) for pair in zip(visitation.states, visitation.actions, strict=True)])


@make_either
@every_game
def test_cost_features_are_those_of_their_formulas(make: Callable[..., DroneGame], drones: int) -> None:
    game = make(drones)
    visitation = some_visitation(game)
    expected = visitation.weights @ table(game, visitation, slow_costs)
    np.testing.assert_allclose(game.cost_features.total(visitation), expected, rtol=0, atol=1e-12)


@make_either
@every_game
def test_reward_features_are_those_of_their_formulas(make: Callable[..., DroneGame], drones: int) -> None:
    game = make(drones)
    visitation = some_visitation(game)
    expected = visitation.weights @ table(game, visitation, slow_rewards)
    np.testing.assert_allclose(game.reward_features.total(visitation), expected, rtol=0, atol=1e-12)


@make_either
@every_game
@pytest.mark.parametrize("kind", ["cost", "reward"])
def test_terms_of_drones_and_pairs_add_up_to_the_weighted_features(
    make: Callable[..., DroneGame], drones: int, kind: str
) -> None:
    game = make(drones)
    features: DroneReward = {"cost": game.cost_features, "reward": game.reward_features}[kind]
    visitation = some_visitation(game)
    rows = table(game, visitation, {"cost": slow_costs, "reward": slow_rewards}[kind])
    weights = np.random.default_rng(5).normal(size=rows.shape[1])
    found = total_reward(game.space, features, weights, visitation.states, visitation.actions)
    np.testing.assert_allclose(found, rows @ weights, rtol=0, atol=1e-12)


@every_game
def test_there_is_one_name_a_feature_and_none_twice(drones: int) -> None:
    game = arena(drones)
    visitation = some_visitation(game)
    for features in (game.cost_features, game.reward_features):
        assert len(features.names) == len(set(features.names)) == len(features.total(visitation))
    nodes, pairs = 5 * 4, drones * (drones - 1) // 2
    assert len(game.cost_features.names) == drones * nodes + 2 * pairs + drones
    assert len(game.reward_features.names) == drones * 3 * 3


def test_names_say_what_the_features_are_of() -> None:
    """Each named place RBF is at its largest, 1, there; the last drone's effort is its own."""
    game = arena(2)
    names = game.cost_features.names
    assert names[:2] == ("drone_1 near (0.00, 0.00) m", "drone_1 near (0.00, 0.40) m")
    assert names[40:] == (
        "drones 1 and 2 within 0.2 m",
        "drones 1 and 2 within 0.5 m",
        "drone_1 effort",
        "drone_2 effort",
    )
    state, action = np.array([[0.0, 0.4, 1.6, 0.0]]), np.array([[0.0, 0.0, 1.2, 0.0]])
    one = game.cost_features.total(Visitation(state, action, np.ones(1)))
    assert one[1] == pytest.approx(1, abs=1e-6)
    assert one[names.index("drone_2 near (1.60, 0.00) m")] == pytest.approx(1, abs=1e-6)
    assert one[42:].tolist() == [0.0, pytest.approx(0.3)]


@pytest.mark.parametrize("radius", [0.04, 0.06, 0.2])
def test_distances_below_two_diameters_are_counts(radius: float) -> None:
    """They are what hardly any flight has; drones are farther apart than that again and again."""
    game = arena(3, {"drone_radius": radius})
    names, counts = np.array(game.cost_features.names), game.cost_features.counts
    levels = [level for level in (0.2, 0.5) if level < 4 * radius]
    expected = [f"drones {i} and {j} within {level:g} m" for i, j in ((1, 2), (1, 3), (2, 3)) for level in levels]
    assert names[counts].tolist() == expected


def test_cost_rbfs_fade_at_a_drones_own_goal_region_and_reward_rbfs_do_not() -> None:
    game = arena(2)
    k = len(game.cost_features.grid.nodes)
    at_first_goal = np.array([[1.3, 1.0, 1.3, 1.0]])
    visitation = Visitation(at_first_goal, np.zeros((1, 4)), np.ones(1))
    costs, rewards = game.cost_features.total(visitation), game.reward_features.total(visitation)
    assert not costs[:k].any()
    assert costs[k : 2 * k].max() > 0.5
    np.testing.assert_array_equal(rewards[:9], rewards[9:])
    assert rewards.max() > 0.5


def test_the_fade_is_one_radius_wide() -> None:
    """At one radius from the goal region's centre 1 - exp(-1/2) of every RBF is left, and all of the other drone's."""
    game = arena(2)
    nodes = game.cost_features.grid.nodes
    place = np.array([1.3 - 0.2, 1.0])
    visitation = Visitation(np.concatenate([place, place])[None], np.zeros((1, 4)), np.ones(1))
    found = game.cost_features.total(visitation)[: len(nodes)]
    whole = np.exp(-((nodes - place) ** 2).sum(axis=1) / (2 * 0.25**2))
    np.testing.assert_allclose(found, whole * (1 - np.exp(-0.5)), rtol=0, atol=1e-12)


@pytest.mark.parametrize("counts", [(1, 1), (1, 4), (3, 2), (7, 5)])
def test_rbf_grids_sum_rbfs_of_every_node(counts: tuple[int, int]) -> None:
    rng = np.random.default_rng(6)
    lattice, places, by_place = RbfGrid((2.0, 1.0), counts, 0.3), rng.random((11, 2)) * 2, rng.normal(size=11)
    assert lattice.nodes.shape == (lattice.size, 2)
    rbfs = np.exp(-((places[:, None] - lattice.nodes) ** 2).sum(axis=-1) / (2 * 0.3**2))
    np.testing.assert_allclose(lattice.total(places, by_place), by_place @ rbfs, rtol=0, atol=1e-12)
    by_node = rng.normal(size=lattice.size)
    np.testing.assert_allclose(lattice.values(by_node, places), rbfs @ by_node, rtol=0, atol=1e-12)


def test_the_true_constraints_of_an_arena_by_hand() -> None:
    """Nodes every 0.4 m; 0.25 m around the obstacle at (0.8, 0.6) are taken, two of them, and 0.2 m < 0.3 m."""
    game = arena(3)
    found = game.true_constraints
    taken = {name for name, true in zip(game.cost_features.names, found, strict=True) if true}
    assert taken == {
        *(f"drone_{i} near (0.80, {y}) m" for i in (1, 2, 3) for y in ("0.40", "0.80")),
        *(f"drones {i} and {j} within 0.2 m" for i, j in ((1, 2), (1, 3), (2, 3))),
    }


def test_a_node_at_the_exact_distance_of_a_obstacle_is_no_true_constraint() -> None:
    """The node (0.5, 0.5) is 0.5 m from an obstacle of 0.25 m, and so large is the drone; nothing is rounded."""
    square = {"arena": (1.0, 1.0), "features.cost_spacing": 0.5, "drone_radius": 0.25, "drones.0.start": (0.0, 0.0)}
    places = {"obstacles": [{"centre": (1.0, 0.5), "radius": 0.25}], "drones.0.goal_region.centre": (0.0, 1.0)}
    assert np.flatnonzero(arena(1, {**square, **places}).true_constraints).tolist() == [7]
    places = {"obstacles": [{"centre": (1.0, 0.5), "radius": 0.2501}], "drones.0.goal_region.centre": (0.0, 1.0)}
    assert np.flatnonzero(arena(1, {**square, **places}).true_constraints).tolist() == [4, 6, 7, 8]


def test_who_breaks_no_constraint_stays_out_of_the_middles_of_true_ones() -> None:
    """A drone that is at the centre of an RBF of a true constraint touches an obstacle; distances alike."""
    game = arena(1)
    nodes = game.cost_features.grid.nodes
    touching = game.obstacle_clearance(np.stack([nodes, nodes], axis=1))[:, 0, 0] < 0
    np.testing.assert_array_equal(game.true_constraints[: len(nodes)], touching)
