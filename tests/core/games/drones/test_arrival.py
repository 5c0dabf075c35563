"""The reward parameter of drones that come too late: against flights that do, and integrals over the disc."""

import numpy as np
import pytest
from arenas import arena, double, random_rollouts

from mabirds_core.arrays import Array
from mabirds_core.games.drones.arrival import LATE_SCALE, ArrivingDroneReward
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lone_fields import FieldGrid, LoneField
from mabirds_core.games.interface import Trajectories, discounted_visitation

WIDE = {f"drones.{drone}.goal_region.radius": 0.4 for drone in range(2)}
DOOR = {"drones.0.goal_region": {"centre": (1.3, 0.7), "until": (1.3, 1.1), "radius": 0.4}}
GAMES = {
    "single": arena(2, {"horizon": 9, **WIDE}),
    "double": double(2, {"horizon": 9, **WIDE}),
    "three": arena(3, {"horizon": 6, **WIDE}),
    "a door": arena(1, {"horizon": 9, **DOOR}),
}
every_game = pytest.mark.parametrize("game", GAMES.values(), ids=GAMES.keys())


def flights(game: DroneGame) -> list[Trajectories]:
    many = random_rollouts(game, 200)
    return [Trajectories(many.states[k : k + 1], many.actions[k : k + 1]) for k in range(200)]


@every_game
def test_its_count_is_one_discounted_where_a_drone_is_under_way_after_the_last_step(game: DroneGame) -> None:
    reward, seen = ArrivingDroneReward(game), set[bool]()
    for flight in flights(game):
        late = ~game.arrived(game.step(flight.states[:, -1], flight.actions[:, -1]))[0]
        begun = ~game.arrived(flight.states[:, 0])[0]
        counts = reward.total(discounted_visitation(flight, game.discount))[-game.n_experts :]
        expected = LATE_SCALE * np.where(begun, game.discount ** (game.horizon + 1) * late, 1.0)
        np.testing.assert_allclose(counts, expected, rtol=0, atol=1e-12)
        seen |= set(late.tolist())
    assert seen == {False, True}


@every_game
def test_the_reward_is_linear_in_theta_with_its_gradient(game: DroneGame) -> None:
    reward = ArrivingDroneReward(game)
    theta = np.random.default_rng(1).normal(size=reward.size)
    states, actions, weights = discounted_visitation(random_rollouts(game, 50), game.discount)
    total = weights @ total_reward(game.space, reward, theta, states, actions)
    gradient = reward.gradient(theta, discounted_visitation(random_rollouts(game, 50), game.discount))
    assert total == pytest.approx(theta @ gradient, abs=1e-9)
    assert reward.initial(np.random.default_rng(0)).tolist() == [0.0] * reward.size
    assert len(reward.names) == reward.size


def test_a_last_decision_of_a_drone_alone_is_the_mean_over_the_disc() -> None:
    """By a million random actions, of which some arrive and some do not."""
    game, rng = arena(1, {"horizon": 1, "drones.0.goal_region.radius": 0.4}), np.random.default_rng(3)
    reward = ArrivingDroneReward(game)
    theta = np.concatenate([rng.normal(size=reward.size - 1), [-0.05]])
    omega = rng.normal(-0.5, 0.5, size=len(game.cost_features.names))
    rewards = ((reward, theta), (game.cost_features, omega))
    place = np.array([[0.9, 0.75]])
    radii, angles = np.sqrt(rng.random(1_000_000)), 2 * np.pi * rng.random(1_000_000)
    actions = 1.2 * np.stack([radii * np.cos(angles), radii * np.sin(angles)], axis=-1)
    earned: Array = sum(of.unary(w, 0, place, actions) for of, w in rewards) / 0.5
    arrived = game.arrived(game.step(np.repeat(place, 1_000_000, axis=0), actions))
    assert 0.1 < arrived.mean() < 0.9
    field = LoneField.of(FieldGrid(game, 0), rewards, 0.5)
    assert field.at(1, place)[0] == pytest.approx(np.log(np.exp(earned).mean()), abs=0.03)


@every_game
def test_lateness_alone_is_a_count_and_no_flight_has_less_than_none(game: DroneGame) -> None:
    """Places are learned by AdaGrad's steps, lateness by ratios."""
    reward = ArrivingDroneReward(game)
    assert [name for name, counts in zip(reward.names, reward.counts, strict=True) if counts] == [
        f"drone_{drone + 1} late" for drone in range(game.n_experts)
    ]
    for flight in flights(game):
        assert (reward.total(discounted_visitation(flight, game.discount))[reward.counts] >= -1e-12).all()
