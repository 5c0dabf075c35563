"""Cost features of the user's own, against loops; the solve by expert with them; what is refused; what is learned."""

from itertools import combinations
from math import dist, exp, inf
from typing import Any

import numpy as np
import pytest
from games import SlowPatrol, doors, hallway, patrol, trio
from pydantic import ValidationError

from mabirds_core.games.interface import Visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.games.patrol.settings import PatrolSettings
from mabirds_core.kernels.loading import library
from mabirds_core.planners.factored import FactoredPolicy
from mabirds_core.planners.occupancy import discounted_steps, occupancy_measure, pairs_of
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner, soft_bellman_policy

COSTS = {"near": "exp(-distance / 2)", "shaded": "shade_1 + shade_2", "apart": "(row_1 - row_2) ** 2 * present_1"}
SHADE = [[0.0, 0.5, 1.0], [0.25, 0.0, 2.0]]


def with_costs(game: PatrolGame, **changes: Any) -> PatrolGame:
    content = {**game.settings.model_dump(), "costs": COSTS, "layers": {"shade": SHADE}, **changes}
    return PatrolGame(PatrolSettings.model_validate(content))


GAMES = {"hallway": with_costs(hallway(horizon=5)), "doors": with_costs(doors(5))}
every_game = pytest.mark.parametrize("game", GAMES.values(), ids=GAMES)


def by_loops(game: PatrolGame) -> np.ndarray:
    """The three features of every joint state, shape (S, 3)."""
    rules = SlowPatrol(game.settings)
    rows = []
    for state in rules.states:
        here = [cell for i, cell in enumerate(state) if not rules.gone(i, cell)]
        distance = min((dist(a, b) for a, b in combinations(here, 2)), default=inf)
        shade = sum(SHADE[row][column] for row, column in here)
        rows.append([exp(-distance / 2), shade, (state[0][0] - state[1][0]) ** 2 * (not rules.gone(0, state[0]))])
    return np.array(rows, dtype=float)


@every_game
def test_the_features_are_what_the_expressions_say(game: PatrolGame) -> None:
    expected = by_loops(game)
    assert game.cost_features.names[-3:] == tuple(COSTS)
    for state in range(game.n_states):
        single = Visitation(np.array([state]), np.array([0]), np.array([2.0]))
        np.testing.assert_allclose(game.cost_features.total(single)[-3:], 2 * expected[state], rtol=1e-14)


@every_game
def test_tables_weigh_what_totals_sum(game: PatrolGame) -> None:
    rng = np.random.default_rng(0)
    weights = rng.normal(size=len(game.cost_features.names))
    pairs = Visitation(rng.integers(game.n_states, size=50), rng.integers(game.n_actions, size=50), rng.random(50))
    by_table = pairs.weights @ game.cost_features.table(weights)[pairs.states, pairs.actions]
    assert by_table == pytest.approx(weights @ game.cost_features.total(pairs), abs=1e-12)


@pytest.mark.skipif(library() is None, reason="kernels are not compiled")
@every_game
def test_by_expert_it_is_what_it_is_by_tables(game: PatrolGame) -> None:
    rng = np.random.default_rng(1)
    theta, omega = (rng.normal(size=len(of.names)) for of in (game.reward_features, game.cost_features))
    fast = SoftBellmanPlanner(game, game.linear_reward(), game.cost_features).plan(theta, omega)
    slow = soft_bellman_policy(game, game.reward_features.table(theta) + game.cost_features.table(omega))
    assert isinstance(fast, FactoredPolicy)
    np.testing.assert_allclose(fast.values, slow.values, rtol=0, atol=1e-12)
    visits = fast.visitation(game.initial_distribution)
    expected = game.cost_features.total(pairs_of(discounted_steps(game) * occupancy_measure(game, slow)))
    np.testing.assert_allclose(game.cost_features.total(visits), expected, rtol=0, atol=1e-12)


def test_they_are_no_true_constraints_and_change_no_trajectories() -> None:
    game = GAMES["hallway"]
    assert game.true_constraints is not None
    assert not game.true_constraints[-3:].any()
    assert game.digest == hallway(horizon=5).digest


def test_of_three_experts_the_nearest_two_decide() -> None:
    game = PatrolGame(trio().settings.model_copy(update={"costs": {"near": "distance", "far": "distance_1_3"}}))
    state = int(game.joint_state(np.array([0, 1, 3])))  # (0, 0), (0, 1), (1, 1)
    total = game.cost_features.total(Visitation(np.array([state]), np.array([0]), np.ones(1)))
    np.testing.assert_allclose(total[-2:], [1.0, np.sqrt(2)])


@pytest.mark.parametrize(("text", "counts"), [("exp(-distance)", True), ("row_1 - 1", False)])
def test_features_say_whether_they_are_counts(text: str, counts: bool) -> None:
    game = PatrolGame(hallway().settings.model_copy(update={"costs": {"mine": text}}))
    assert game.cost_features.nonnegative is counts


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"costs": {"near": "1 / distance"}},
            r"costs.near '1 / distance': inf where the experts are in \[\(0, 0\), \(0, 0\)\]",
        ),
        ({"costs": {"near": "log(distance - 9)"}}, "costs.near .* expected finite numbers everywhere"),
        ({"costs": {"near": "distance_1_3"}}, r"costs.near: \['distance_1_3'\] is none of \['column_1', .*'shade_2'\]"),
        ({"costs": {"near": "open('x')"}}, "expected numbers, names"),
        ({"costs": {"Near to": "distance"}}, "costs"),
        ({"layers": {"shade": [[1.0, 2.0], [0.0, 0.0]]}}, "layers.shade: expected 2 rows of 3 numbers, as the map has"),
        ({"layers": {"row": SHADE, "shade": SHADE}}, "layers.row: expected another name than row, column"),
        ({"costs": {f"cost_{k}": "distance" for k in range(33)}}, "costs\n.*at most 32"),
    ],
    ids=str,
)
def test_wrong_costs_are_refused_by_name(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        with_costs(hallway(), **change)


def test_that_experts_keep_apart_is_learned_as_a_cost_of_nearness() -> None:
    """Demonstrations of a policy that nearness costs 3 nats: the likeliest omega of nearness is near -3."""
    plain = patrol("....\n....\n....", [((0, 0), (2, 3))], [(2, 3), (0, 0)], 9, 0.95, costs={"near": "exp(-distance)"})
    truth = np.zeros(len(plain.cost_features.names))
    truth[-1] = -3.0
    theta = -0.5 * np.ones(len(plain.reward_features.names))
    policy = soft_bellman_policy(plain, plain.reward_features.table(theta) + plain.cost_features.table(truth))
    shown = plain.cost_features.total(pairs_of(discounted_steps(plain) * occupancy_measure(plain, policy)))[-1]
    low, high = -10.0, 0.0
    for _ in range(40):
        middle = (low + high) / 2
        truth[-1] = middle
        tried = soft_bellman_policy(plain, plain.reward_features.table(theta) + plain.cost_features.table(truth))
        expected = plain.cost_features.total(pairs_of(discounted_steps(plain) * occupancy_measure(plain, tried)))[-1]
        low, high = (low, middle) if expected > shown else (middle, high)
    assert middle == pytest.approx(-3.0, abs=1e-6)


RING = "3 * exp(-(distance - 2) ** 2) + shade_1"


@every_game
def test_what_experts_really_pay_is_in_their_reward_and_no_feature(game: PatrolGame) -> None:
    paying = with_costs(game, true_cost=RING)
    rules, expected = SlowPatrol(game.settings), list[float]()
    for state in rules.states:
        here = [cell for i, cell in enumerate(state) if not rules.gone(i, cell)]
        distance = min((dist(a, b) for a, b in combinations(here, 2)), default=inf)
        shade = 0.0 if rules.gone(0, state[0]) else SHADE[state[0][0]][state[0][1]]
        expected.append(3 * exp(-((distance - 2) ** 2)) + shade)
    difference = game.task_reward - paying.task_reward
    np.testing.assert_allclose(difference, np.repeat(np.array(expected)[:, None], game.n_actions, axis=1), atol=1e-14)
    assert not game.true_cost.any()
    assert paying.cost_features.names == game.cost_features.names
    assert paying.digest == game.digest


def test_experts_shun_what_they_pay_for() -> None:
    plain = patrol("....\n....\n....", [((0, 0), (2, 3))], [(2, 3), (0, 0)], 9, 0.95, costs={"near": "exp(-distance)"})
    paying = with_costs(plain, true_cost="20 * exp(-distance)", costs=plain.settings.costs, layers={})
    near = [
        game.cost_features.total(pairs_of(occupancy_measure(game, game.experts("soft", "by_start").policy)))[-1]
        for game in (plain, paying)
    ]
    assert near[1] < 0.7 * near[0]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"true_cost": "1 / distance"}, "true_cost '1 / distance': inf where"),
        ({"true_cost": "distance_1_3"}, r"true_cost: \['distance_1_3'\] is none of"),
        ({"true_cost": RING, "truth": "unknown", "map": "...\n..."}, "truth unknown: expected no true_cost"),
    ],
    ids=str,
)
def test_wrong_true_costs_are_refused_by_name(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        with_costs(hallway(), **change)
