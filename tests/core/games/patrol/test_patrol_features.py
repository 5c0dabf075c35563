"""Features of the patrol game against slow lists of features, and the duality of totals and tables."""

from collections.abc import Callable

import numpy as np
import pytest
from games import Cell, SlowPatrol, alone, crossing_diagonals, doors, hallway, random_policy, trio
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.arrays import Array
from mabirds_core.games.interface import FeatureMap, Visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.occupancy import ExactOccupancy

GAMES = {
    "one expert": alone(),
    "two experts": hallway(),
    "three experts": trio(),
    "doors": doors(1),
    "diagonals": crossing_diagonals(),
}
KINDS = ["cost", "reward"]


def fast(game: PatrolGame, kind: str) -> FeatureMap:
    return game.cost_features if kind == "cost" else game.reward_features


def slow(game: PatrolGame, kind: str) -> Array:
    """features[s, a, k], by loops."""
    rules = SlowPatrol(game.settings)
    return rules.feature_table(rules.cost_features if kind == "cost" else rules.reward_features)


SLOW = {(name, kind): slow(game, kind) for name, game in GAMES.items() for kind in KINDS}

both_kinds = pytest.mark.parametrize("kind", KINDS)
every_game = pytest.mark.parametrize("name", GAMES)


def random_visitation(game: PatrolGame, seed: int, size: int = 40) -> Visitation:
    rng = np.random.default_rng(seed)
    pairs = rng.integers(game.n_states, size=size), rng.integers(game.n_actions, size=size)
    return Visitation(*pairs, rng.normal(size=size))


@both_kinds
@every_game
def test_the_total_of_one_pair_is_its_list_of_features(name: str, kind: str) -> None:
    game, table = GAMES[name], SLOW[name, kind]
    features, rng = fast(game, kind), np.random.default_rng(0)
    for state in rng.choice(game.n_states, size=min(60, game.n_states), replace=False):
        action = rng.integers(game.n_actions)
        single = Visitation(np.array([state]), np.array([action]), np.array([1.0]))
        np.testing.assert_array_equal(features.total(single), table[state, action])


@both_kinds
@every_game
def test_a_total_is_the_weighted_sum_of_the_pairs_features(name: str, kind: str) -> None:
    game, table = GAMES[name], SLOW[name, kind]
    visitation = random_visitation(game, seed=1)
    expected = sum(weight * table[s, a] for s, a, weight in zip(*visitation, strict=True))
    np.testing.assert_allclose(fast(game, kind).total(visitation), expected, rtol=0, atol=1e-12)


@both_kinds
@every_game
def test_a_table_is_the_weighted_sum_of_every_pairs_features(name: str, kind: str) -> None:
    game, table = GAMES[name], SLOW[name, kind]
    weights = np.random.default_rng(2).normal(size=table.shape[-1])
    np.testing.assert_allclose(fast(game, kind).table(weights), table @ weights, rtol=0, atol=1e-12)


@both_kinds
@given(seed=st.integers(0, 2**32 - 1), name=st.sampled_from(list(GAMES)), size=st.integers(0, 50))
def test_weights_of_totals_are_totals_of_tables(kind: str, seed: int, name: str, size: int) -> None:
    game = GAMES[name]
    features, visitation = fast(game, kind), random_visitation(game, seed, size)
    weights = np.random.default_rng(seed + 1).normal(size=len(features.names))
    through_table = visitation.weights @ features.table(weights)[visitation.states, visitation.actions]
    assert weights @ features.total(visitation) == pytest.approx(through_table, abs=1e-10)


@both_kinds
@every_game
def test_features_have_one_name_each_all_different(name: str, kind: str) -> None:
    names = fast(GAMES[name], kind).names
    assert len(names) == SLOW[name, kind].shape[-1] == len(set(names))


def names_of_active(features: FeatureMap, state: int, action: int) -> set[str]:
    total = features.total(Visitation(np.array([state]), np.array([action]), np.array([1.0])))
    return {features.names[k] for k in np.flatnonzero(total)}


def pair(game: PatrolGame, cells: list[Cell], moves: list[int]) -> tuple[int, int]:
    rules = SlowPatrol(game.settings)
    return rules.states.index(tuple(cells)), rules.actions.index(tuple(moves))


@pytest.mark.parametrize(
    ("cells", "moves", "expected"),
    [
        ([(0, 0), (1, 2)], [1, 0], {"expert_1 in (0, 0)", "expert_2 in (1, 2)"}),
        ([(0, 1), (0, 1)], [1, 1], {"expert_1 in (0, 1)", "expert_2 in (0, 1)", "sharing a cell"}),
        ([(0, 1), (1, 1)], [2, 0], {"expert_1 in (0, 1)", "expert_2 in (1, 1)", "swapping cells"}),
    ],
    ids=["apart", "sharing", "swapping"],
)
def test_names_of_active_cost_features(cells: list[Cell], moves: list[int], expected: set[str]) -> None:
    game = hallway()
    assert names_of_active(game.cost_features, *pair(game, cells, moves)) == expected


def test_names_of_active_reward_features() -> None:
    game = hallway()
    expected = {"expert_1 in (0, 0) going east", "expert_2 in (1, 2) going north"}
    assert names_of_active(game.reward_features, *pair(game, [(0, 0), (1, 2)], [1, 0])) == expected


@pytest.mark.parametrize("build", [alone, hallway, trio], ids=lambda build: build.__name__)
def test_true_constraints_are_obstacles_sharing_and_swapping_by_name(build: Callable[[], PatrolGame]) -> None:
    game = build()
    true = {game.cost_features.names[k] for k in np.flatnonzero(game.true_constraints)}
    experts = [f"expert_{i + 1}" for i in range(game.n_experts)]
    joint = {"sharing a cell", "swapping cells"} if game.n_experts > 1 else set()
    assert true == {f"{expert} in (1, 1)" for expert in experts} | joint


def test_the_joint_features_count_as_often_as_the_settings_say() -> None:
    plain = hallway()
    scaled = PatrolGame(plain.settings.model_copy(update={"joint_scale": 3.0}))
    visitation = ExactOccupancy(plain)(random_policy(plain, np.random.default_rng(0)), np.random.default_rng(0))
    once, thrice = (game.cost_features.total(visitation) for game in (plain, scaled))
    np.testing.assert_allclose(thrice, once * np.repeat([1.0, 3.0], [len(once) - 2, 2]), atol=1e-12)
    weights = np.random.default_rng(1).normal(size=len(once))
    seen = scaled.cost_features.table(weights)[visitation.states, visitation.actions]
    np.testing.assert_allclose(visitation.weights @ seen, weights @ thrice, atol=1e-9)
    assert once[-2:].all()
