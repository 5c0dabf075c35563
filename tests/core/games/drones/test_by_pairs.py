"""Three drones by pairs: what each pair earns, where pairs are all there is, and how far off they are elsewhere."""

from typing import Any

import numpy as np
import pytest
from arenas import ARENA, arena, arena_settings, drone_experiment, drone_game, random_rollouts
from slow_trio import Trio

from mabirds_core.arrays import Array, Vector
from mabirds_core.experiment.simulate import Progress, simulate_central
from mabirds_core.games.drones.arrival import ArrivingDroneReward
from mabirds_core.games.drones.features import total_reward
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.guide import Guide
from mabirds_core.games.drones.guided_actor import GuidedPlanner, GuidedPolicy
from mabirds_core.games.drones.pair_games import pair_game, rewards_of_pair
from mabirds_core.games.drones.planner_settings import SoftActorCriticSettings
from mabirds_core.games.drones.rewards import LinearDroneReward, TrueDroneReward
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.whole_game import WholeDroneGame


def test_what_pairs_earn_is_what_the_whole_earns() -> None:
    """Each drone's own terms are in two pairs; costs of the user's own name drones of the whole game."""
    game = arena(3, {"costs": {"high": "y_3", "near": "exp(-distance_2_3)", "fast": "speed"}})
    reward, rng = ArrivingDroneReward(game), np.random.default_rng(0)
    rewards = (
        (reward, rng.normal(size=reward.size)),
        (game.cost_features, rng.normal(size=len(game.cost_features.names))),
    )
    states, actions = rng.uniform(0.1, 1.1, size=(50, 6)), rng.uniform(-0.8, 0.8, size=(50, 6))
    places, controls = game.positions(states), game.controls(actions)
    by_pairs = np.zeros(50)
    for pair, drones in enumerate(game.pairs):
        space, chosen = pair_game(game, pair).space, list(drones)
        of_pair = [of[:, chosen].reshape(50, -1) for of in (places, controls)]
        by_pairs += sum(total_reward(space, of, w, *of_pair) for of, w in rewards_of_pair(game, pair, rewards))
    alone = sum(of.unary(w, i, places[:, i], controls[:, i]) for of, w in rewards for i in range(3))
    whole = sum(total_reward(game.space, of, w, states, actions) for of, w in rewards)
    assert np.allclose(by_pairs - alone, whole)


def guide_of(game: DroneGame, omega: Vector, seed: int | None = None) -> Guide:
    reward = LinearDroneReward(game)
    theta, rng = (
        np.random.default_rng(0).normal(size=reward.size),
        None if seed is None else np.random.default_rng(seed),
    )
    return GuidedPlanner.of(game, reward, 0.5).plan(theta, omega, None, rng).guide


def costs_of(game: DroneGame, of_distances: float) -> Vector:
    """Random ones of places, and of a step of a distance ``of_distances`` in units of the reward."""
    omega = np.random.default_rng(1).normal(-0.5, 0.5, size=len(game.cost_features.names))
    steps = [" within " in name for name in game.cost_features.names]
    omega[steps] = -of_distances / game.settings.features.distance_scale
    return omega


def test_all_pairs_are_on_the_lattice_of_one_draw() -> None:
    game = arena(3)
    lattices = [
        {
            drone.nodes.lattice
            for coupling in guide_of(game, costs_of(game, 1.0), seed).couplings
            for drone in coupling.lattice.drones
        }
        for seed in range(4)
    ]
    assert [len(of) for of in lattices] == [1] * 4
    assert len(set.union(*lattices)) > 1


def test_who_judges_does_so_on_a_lattice_that_no_learner_draws() -> None:
    game = WholeDroneGame(arena_settings(3))
    settings = SoftActorCriticSettings(kind="soft_actor_critic", temperature=0.5)
    reward, omega = LinearDroneReward(game), costs_of(game, 1.0)
    judge = game.evaluation_planner(settings, reward)
    assert isinstance(judge, GuidedPlanner)
    policies = [judge.plan(np.zeros(reward.size), omega, None, np.random.default_rng(seed)) for seed in range(3)]
    found = {policy.guide.couplings[0].lattice.drones[0].nodes.lattice for policy in policies}
    assert found == {judge.guidance.pairs[0].lattices[0][0].lattice}


def test_memory_is_taken_over_pair_by_pair() -> None:
    game = arena(3)
    planner, omega = GuidedPlanner.of(game, TrueDroneReward(game), 0.5), costs_of(game, 1.0)
    first = planner.plan(np.zeros(0), omega)
    memory = [coupling.lattice.memory for coupling in first.guide.couplings]
    second = planner.plan(np.zeros(0), omega, first)
    assert all(coupling.lattice.memory is of for coupling, of in zip(second.guide.couplings, memory, strict=True))
    assert not any(coupling.lattice.tables for coupling in first.guide.couplings)


def test_where_the_third_is_far_values_are_those_of_two_and_one() -> None:
    """In a long hall, at whose other end the third flies; the game of two has the same parameters by name."""
    wide: dict[str, Any] = {**ARENA, "arena": (5.2, 1.2)}
    far = {"start": (4.9, 0.6), "start_spread": 0.1, "goal_region": {"centre": (4.2, 0.6), "radius": 0.2}}
    three, two, one = (
        DroneGame(DroneSettings.model_validate({**wide, "drones": drones}))
        for drones in ([*ARENA["drones"][:2], far], ARENA["drones"][:2], [far])
    )
    theta, omega = np.random.default_rng(3).normal(size=LinearDroneReward(three).size), costs_of(three, 2.0)
    values = []
    for game, numbers, at in ((three, (1, 2, 3), slice(0, 6)), (two, (1, 2), slice(0, 4)), (one, (3,), slice(4, 6))):
        chosen = [chosen_by_name(three, numbers, names) for names in names_of(three)]
        guide = GuidedPlanner.of(game, LinearDroneReward(game), 0.5).plan(theta[chosen[0]], omega[chosen[1]]).guide
        places = np.random.default_rng(4).uniform([0.1, 0.1, 0.6, 0.1, 4.5, 0.1], [1, 1.1, 1.5, 1.1, 5, 1.1], (40, 6))
        values.append(np.stack([guide.values(step, places[:, at]) for step in (1, 2, 3)]))
    assert np.allclose(values[0], values[1] + values[2], atol=0.01)


def names_of(game: DroneGame) -> tuple[tuple[str, ...], ...]:
    return game.reward_features.names, game.cost_features.names


def chosen_by_name(game: DroneGame, drones: tuple[int, ...], names: tuple[str, ...]) -> list[int]:
    """Features that name none but these drones."""
    others = [i for i in range(1, game.n_experts + 1) if i not in drones]

    def named(name: str) -> bool:
        who = name.partition("near")[0].partition("within")[0]
        return any(str(i) in who for i in others)

    return [k for k, name in enumerate(names) if not named(name)]


@pytest.mark.parametrize(
    ("cost", "off", "lost"),
    [(0.0, 1e-3, 1e-3), (0.6, 1.0, 0.02), (2.0, 4.0, 0.2), (20.0, 60.0, 0.5)],
)
def test_what_pairs_miss(cost: float, off: float, lost: float) -> None:
    """Against three drones on a lattice, solved together, from every three nodes at every step.

    Where all are near each other V is off by much of what their distances cost. But it is so for all that they can
    do: a policy that is drawn by it loses next to nothing.
    """
    game = arena(3, {"horizon": 4})
    trio = Trio.of(guide_of(game, costs_of(game, cost)))
    missed = [np.abs(pairs - exact) for pairs, exact in zip(trio.by_pairs, trio.exact, strict=True)]
    losses = [exact - earned for exact, earned in zip(trio.exact, trio.earned, strict=True)]
    assert max(of.max() for of in missed) < off
    assert min(of.min() for of in losses) > -1e-3
    assert max(of.max() for of in losses) < lost
    if cost:
        assert max(of.max() for of in missed) > off / 10
        near, apart = [of < 0.5 for of in trio.distances(2)], [of > 0.9 for of in trio.distances(2)]
        together, third_apart = near[0] & near[1] & near[2], apart[1] & apart[2]
        assert missed[1][third_apart].mean() < missed[1][together].mean() / 5


def flown(policy: GuidedPolicy, seed: int) -> Array:
    return drone_rollouts(policy.game, policy, 400, np.random.default_rng(seed)).states


def test_three_drones_keep_off_each_other() -> None:
    """As random ones do not."""
    game = arena(3, {"horizon": 8, "least_distance": 0.2})
    reward = LinearDroneReward(game)
    policy = GuidedPlanner.of(game, reward, 0.5).plan(np.zeros(reward.size), 4 * costs_of(game, 3.0))
    too_near = [
        (game.separation_clearance(of) < 0).any(axis=1).mean()
        for of in (flown(policy, 1), random_rollouts(game, 400).states)
    ]
    assert too_near[0] < 0.02
    assert too_near[1] > 0.1


def test_a_central_method_learns_three_drones() -> None:
    changes = {"game.drones": ARENA["drones"], "algorithm.policy": {"kind": "soft_actor_critic", "temperature": 1.0}}
    experiment = drone_experiment(changes)
    game, found = drone_game(experiment), list[Progress]()
    shown = GuidedPlanner.of(game, TrueDroneReward(game), 0.1).plan(
        np.zeros(0), np.zeros(len(game.cost_features.names))
    )
    rng = np.random.default_rng(0)
    streams = {name: [drone_rollouts(game, shown, 1, rng) for _ in range(5)] for name in experiment.learners}
    history = simulate_central(experiment, "bics", streams, found.append)
    assert len(history["bics"]) == 6
    assert isinstance(found[-1].policy, GuidedPolicy)
    assert abs(found[-1].policy.gap(1, 200)) < 1.0
    assert np.abs(history["bics"][-1].omega).max() > 0
