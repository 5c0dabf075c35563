"""Likelihoods of demonstrations on a lattice: of its own flights, of flights beside them, and of the judge."""

import numpy as np
import pytest
from arenas import arena, random_rollouts

from mabirds_core.games.drones.demonstrated import NOISES, log_ratios, snapped, straight_log_ratios
from mabirds_core.games.drones.judge import RolloutJudge
from mabirds_core.games.drones.lattice import LatticePlanner, LatticePolicy
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.interface import Trajectories

every_size = pytest.mark.parametrize("drones", [1, 2])


def some_policy(drones: int, scale: float = 1.0) -> LatticePolicy:
    model = LinearDroneReward(arena(drones, {"horizon": 6}))
    rng = np.random.default_rng(0)
    omega = scale * rng.normal(size=len(model.game.cost_features.names))
    return LatticePlanner(model.game, model, 0.15, 1.0).plan(scale * rng.normal(size=model.size), omega)


@every_size
def test_the_policys_own_flights_have_the_ratios_of_their_moves(drones: int) -> None:
    policy = some_policy(drones)
    flights = drone_rollouts(policy.game, policy, 20, np.random.default_rng(1))
    expected = np.zeros(20)
    for step in range(policy.game.horizon + 1):
        here, action = flights.states[:, step], flights.actions[:, step]
        places = policy.game.positions(policy.game.step(here, action))
        nodes = [drone.nodes.nearest(places[:, i]) for i, drone in enumerate(policy.drones)]
        expected += policy.choices(step, here).log_ratios(nodes)
    np.testing.assert_allclose(log_ratios(policy, flights), expected, rtol=0, atol=1e-9)
    assert expected.mean() > 0.5


@every_size
def test_flights_between_the_nodes_are_those_of_the_nearest_ones(drones: int) -> None:
    policy = some_policy(drones)
    flights = drone_rollouts(policy.game, policy, 20, np.random.default_rng(1))
    moved = flights.states + np.random.default_rng(2).uniform(-0.02, 0.02, flights.states.shape)
    moved[:, 0] = flights.states[:, 0]
    beside = Trajectories(moved, flights.actions)
    same = log_ratios(policy, beside) - log_ratios(policy, flights)
    assert np.median(np.abs(same)) < 1e-6
    random = random_rollouts(policy.game, 20)
    assert log_ratios(policy, random).mean() < log_ratios(policy, flights).mean() - 0.5


def test_a_place_in_the_goal_region_is_a_node_of_it() -> None:
    """Whichever node is the nearest, the drone stays there then, which says nothing more of the policy."""
    policy = some_policy(1)
    game, (drone,) = policy.game, policy.drones
    inside = drone.nodes.arrived(drone.nodes.places)
    rim = [1.3, 1.0] + 0.199 * np.column_stack([np.cos(np.arange(6)), np.sin(np.arange(6))])
    outside = ~inside[drone.nodes.nearest(rim)]
    edge = rim[outside][:1]
    start = game.starts(1, np.random.default_rng(0))
    states = start + np.linspace(0, 1, game.horizon + 1)[:, None] * (edge - start)
    shown = Trajectories(states[None], np.zeros((1, game.horizon + 1, 2)))
    here, total = start, 0.0
    for step in range(game.horizon):
        choices = policy.choices(step, here)
        (targets,) = choices.nodes
        allowed = targets[0][inside[targets[0]]] if step == game.horizon - 1 else targets[0][targets[0] >= 0]
        nearest = allowed[np.hypot(*(drone.nodes.places[allowed] - states[step + 1]).T).argmin()]
        total += float(choices.log_ratios([np.array([nearest])])[0])
        here = drone.nodes.places[[nearest]]
    assert inside[nearest]
    np.testing.assert_allclose(log_ratios(policy, shown), total, rtol=0, atol=1e-9)


@every_size
def test_nothing_is_likelier_than_under_the_uniform_policy_to_the_uniform_policy(drones: int) -> None:
    policy = some_policy(drones, scale=0.0)
    np.testing.assert_allclose(log_ratios(policy, random_rollouts(policy.game, 20)), 0, atol=1e-4)


def test_the_judge_says_so_and_certifies() -> None:
    policy = some_policy(2)
    judge, shown = RolloutJudge(policy.game), random_rollouts(policy.game, 5)
    np.testing.assert_array_equal(judge.log_likelihoods(policy, shown), log_ratios(policy, shown))
    certificate = judge.certificate(policy, 0)
    assert certificate is not None
    assert 0 < certificate < 0.1
    assert judge.log_likelihoods(object(), shown) is None
    assert judge.certificate(object(), 0) is None
    assert judge.fixed_log_likelihoods(object(), shown) == {}
    straight = straight_log_ratios(policy, shown).mean()
    assert judge.fixed_log_likelihoods(policy, shown) == {"uniform": 0.0, "straight flight": straight}


def straight_by_hand(policy: LatticePolicy, shown: Trajectories, noise: float) -> float:
    """Mean over demonstrations of the sum over steps and drones, one number after the other."""
    game, total = policy.game, 0.0
    for at in snapped(game, [of.nodes for of in policy.drones], shown):
        for m in np.flatnonzero(at.under_way):
            for i, drone in enumerate(policy.drones):
                place = at.states[m, 2 * i : 2 * i + 2]
                way = np.array(game.settings.drones[i].goal_region.centre) - place
                aim = place + way * min(1.0, 0.3 / np.hypot(*way))
                (moves,), (shares,) = drone.nodes.moves_from(place[None])
                away = {n: np.hypot(*(drone.nodes.places[n] - aim)) for n in moves if n >= 0}
                pulls = {n: np.exp(-(distance**2) / (2 * noise**2)) for n, distance in away.items()}
                mean = sum(share * pulls[n] for n, share in zip(moves, shares, strict=True) if n >= 0)
                total += np.log(pulls[at.nodes[i][m]] / mean)
    return total / len(shown.states)


@every_size
def test_straight_flight_has_the_noise_that_suits_best(drones: int) -> None:
    policy = some_policy(drones)
    shown = random_rollouts(policy.game, 6)
    by_noise = [straight_by_hand(policy, shown, 0.3 * noise) for noise in NOISES[NOISES > 0.2]]
    assert straight_log_ratios(policy, shown).mean() == pytest.approx(max(by_noise))
    assert np.argmax(by_noise) > 0


def test_who_flies_straight_is_told_by_it() -> None:
    """Straight ways are far likelier than to the uniform policy; who stays where it is knows nothing of the way."""
    policy = some_policy(2)
    game, start = policy.game, policy.game.starts(4, np.random.default_rng(0))
    goals = np.concatenate([task.goal_region.centre for task in game.settings.drones])
    shares = np.minimum(0.25 * np.arange(game.horizon + 1), 1.0)[:, None]
    straight, stays = start[:, None] + shares * (goals - start)[:, None], np.repeat(start[:, None], len(shares), axis=1)
    still = np.zeros((4, game.horizon + 1, 4))
    assert straight_log_ratios(policy, Trajectories(straight, still)).mean() > 5
    assert straight_log_ratios(policy, Trajectories(stays, still)).mean() < 1
