"""Cost features of the user's own for drones, by loops; in the planner's terms; what is refused; what is learned."""

from collections.abc import Callable
from itertools import combinations
from math import exp, hypot
from typing import Any

import numpy as np
import pytest
from arenas import arena, arena_settings, double, drone_experiment, drone_game, random_rollouts
from pydantic import ValidationError

from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.learned_costs import distance_costs, place_costs
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.interface import Visitation, discounted_visitation

COSTS = {
    "near": "exp(-distance / 0.3)",
    "second": "distance_1_2 ** 2",
    "fast_in_the_west": "speed * (x < 0.8)",
    "high": "y_1 + 2 * x_1",
    "always": "max(x, y)",
}
make_either = pytest.mark.parametrize("make", [arena, double])


def by_hand(game: DroneGame, state: Any, action: Any) -> list[float]:
    """The five features of one joint state and action."""
    drones = game.drones(state).tolist()
    controls = game.controls(action).tolist()
    velocities = [drone[2:] if len(drone) == 4 else control for drone, control in zip(drones, controls, strict=True)]
    apart = {
        pair: hypot(drones[pair[0]][0] - drones[pair[1]][0], drones[pair[0]][1] - drones[pair[1]][1])
        for pair in combinations(range(len(drones)), 2)
    }
    return [
        sum(exp(-distance / 0.3) for distance in apart.values()),
        apart[0, 1] ** 2,
        sum(hypot(*velocity) * (drone[0] < 0.8) for drone, velocity in zip(drones, velocities, strict=True)),
        drones[0][1] + 2 * drones[0][0],
        sum(max(drone[0], drone[1]) for drone in drones),
    ]


@make_either
@pytest.mark.parametrize("drones", [2, 3])
def test_the_features_are_what_the_expressions_say(make: Callable[..., DroneGame], drones: int) -> None:
    game = make(drones, {"costs": COSTS})
    states, actions, _ = discounted_visitation(random_rollouts(game, 6, 1), game.discount)
    weights = np.random.default_rng(0).normal(size=len(states))
    expected = weights @ np.array([by_hand(game, *pair) for pair in zip(states, actions, strict=True)])
    found = game.cost_features.total(Visitation(states, actions, weights))
    assert game.cost_features.names[-5:] == tuple(COSTS)
    np.testing.assert_allclose(found[-5:], expected, rtol=0, atol=1e-12)
    plain = make(drones)
    np.testing.assert_array_equal(found[:-5], plain.cost_features.total(Visitation(states, actions, weights)))


@make_either
@pytest.mark.parametrize("drones", [2, 3])
def test_terms_of_drones_and_pairs_add_up_to_the_weighted_features(make: Callable[..., DroneGame], drones: int) -> None:
    game = make(drones, {"costs": COSTS})
    states, actions, _ = discounted_visitation(random_rollouts(game, 6, 2), game.discount)
    omega = np.random.default_rng(3).normal(size=len(game.cost_features.names))
    earned = total_reward(game.space, game.cost_features, omega, states, actions)
    for k in range(len(states)):
        single = Visitation(states[[k]], actions[[k]], np.ones(1))
        assert earned[k] == pytest.approx(omega @ game.cost_features.total(single), abs=1e-11)


def test_they_change_no_trajectories_and_are_no_true_constraints() -> None:
    game = arena(2, {"costs": COSTS})
    assert game.digest == arena(2).digest
    assert game.true_constraints is not None
    assert game.true_constraints.shape == (len(game.cost_features.names),)
    assert not game.true_constraints[-5:].any()


def test_what_was_learned_of_places_and_distances_has_them_in_it() -> None:
    game = arena(2, {"costs": {"near": "exp(-distance)", "west": "2 - x"}})
    omega = np.zeros(len(game.cost_features.names))
    omega[-2:] = -3.0, -0.5
    np.testing.assert_allclose(distance_costs(game, omega, 0, np.array([0.0, 1.0])), [3.0, 3.0 * np.exp(-1)])
    np.testing.assert_allclose(place_costs(game, omega, 1, np.array([[0.0, 0.3], [1.0, 0.3]])), [1.0, 0.5])


@pytest.mark.parametrize(
    ("costs", "message"),
    [
        ({"mixed": "x * distance"}, "costs.mixed 'x \\* distance': expected x, y and speed of every drone or of one"),
        ({"two": "x_1 + x_2"}, "no two of these in one expression"),
        ({"both": "x + x_2"}, "no two of these in one expression"),
        ({"none": "3"}, "expected x, y and speed"),
        ({"unknown": "height"}, "expected x, y and speed"),
        ({"third": "x_3"}, "expected a drone from 1 to 2"),
        ({"pair": "distance_2_1"}, "there is no such pair of drones, the lower first"),
        ({"endless": "1 / distance"}, "costs.endless .* expected finite numbers everywhere in the arena"),
        ({"no": "log(x)"}, "expected finite numbers"),
        ({"Upper": "x"}, "costs"),
        ({"code": "open('x')"}, "expected numbers, names"),
    ],
    ids=str,
)
def test_wrong_costs_are_refused_by_name(costs: dict[str, str], message: str) -> None:
    with pytest.raises(ValidationError, match=message):
        arena_settings(2, {"costs": costs})


def test_drones_fly_slower_and_further_apart_where_that_is_dear() -> None:
    game = arena(2, {"costs": {"near": "exp(-distance)", "fast": "speed ** 2"}, "horizon": 6})
    reward = LinearDroneReward(game)
    planner, theta = LatticePlanner(game, reward, spacing=0.173, temperature=0.1), np.zeros(reward.size)
    counts = {}
    for name, dear in (("free", (0.0, 0.0)), ("dear", (-2.0, -0.5))):
        omega = np.zeros(len(game.cost_features.names))
        omega[-2:] = dear
        flights = drone_rollouts(game, planner.plan(theta, omega), 60, np.random.default_rng(0))
        counts[name] = game.cost_features.total(discounted_visitation(flights, game.discount))[-2:]
    assert (counts["dear"] < 0.8 * counts["free"]).all()


def test_an_experiment_with_them_is_read_and_built() -> None:
    settings = drone_experiment({"game.costs": {"near": "exp(-distance / 0.3)"}})
    assert drone_game(settings).cost_features.names[-1] == "near"
    assert settings.digest != drone_experiment().digest
    assert drone_experiment({"game.costs": {}}).digest == drone_experiment().digest
