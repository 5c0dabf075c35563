"""The actor by exact values: cells of actions, densities, how near it is to V_0, and whose networks it replaces."""

import numpy as np
import pytest
from arenas import ARENA, arena, double

from mabirds_core.arrays import Array
from mabirds_core.errors import ExperimentError
from mabirds_core.games.drones.arrival import ArrivingDroneReward
from mabirds_core.games.drones.disc_cells import DiscCells
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.guided_actor import CELLS, GuidedPlanner, GuidedPolicy
from mabirds_core.games.drones.kind import build_soft_actor_critic
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.metrics import place_visitation, visitation_distance
from mabirds_core.games.drones.planner_checks import check_soft_actor_critic
from mabirds_core.games.drones.planner_settings import SoftActorCriticSettings
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.drones.settings import DroneSettings


def policy_of(drones: int, temperature: float, late: float = 0.0, horizon: int = 8, seed: int = 0) -> GuidedPolicy:
    game = arena(drones, {"horizon": horizon})
    reward, rng = ArrivingDroneReward(game), np.random.default_rng(seed)
    theta, omega = rng.normal(size=reward.size), rng.normal(-0.5, 0.5, size=len(game.cost_features.names))
    theta[reward.counts] = -late / 10
    return GuidedPlanner.of(game, reward, temperature).plan(theta, omega, None, rng)


def test_cells_cover_the_disc_by_their_shares() -> None:
    """Each cell drawn by its share, and each part of it as often: uniform in the disc."""
    cells, rng = DiscCells(3, 5, 2), np.random.default_rng(0)
    assert cells.shares.sum() == pytest.approx(1)
    which = rng.choice(cells.count, size=100_000, p=cells.shares)
    places = cells.places(which, rng.integers(4, size=len(which)), rng)
    squares, angles = (places**2).sum(axis=1), np.arctan2(places[:, 1], places[:, 0]) / (2 * np.pi) % 1
    for uniform in (squares, angles):
        assert np.abs(np.histogram(uniform, 10, (0, 1))[0] / 10_000 - 1).max() < 0.05


def test_points_and_parts_are_in_their_cells() -> None:
    def cell_of(places: Array) -> Array:
        ring = np.searchsorted(CELLS._edges, (places**2).sum(axis=-1)) - 1
        turns = np.arctan2(places[..., 1], places[..., 0]) / (2 * np.pi) % 1
        return ring * CELLS.sectors + np.floor(turns * CELLS.sectors).astype(int)

    numbers = np.arange(CELLS.count)
    assert (cell_of(CELLS.points) == numbers).all()
    assert (cell_of(CELLS.middles) == numbers[:, None]).all()
    assert len(np.unique(CELLS.middles.reshape(-1, 2).round(9), axis=0)) == CELLS.count * CELLS.parts**2


@pytest.mark.parametrize("drones", [1, 2, 3])
def test_the_density_is_that_of_what_is_drawn(drones: int) -> None:
    """E over actions of exp(-log pi) is the share of the discs that is covered, in all and of halves."""
    policy, rng = policy_of(drones, 2.0), np.random.default_rng(1)
    states = np.tile([0.5, 0.4, 1.1, 0.5, 0.8, 0.9][: 2 * drones], (2000, 1))
    parts = [policy.drawn(3, states, rng) for _ in range(15)]
    actions, log_pi = np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])
    assert np.std(log_pi) > 0.1
    assert np.hypot(*actions[:, :2].T).max() <= 1.2
    for inner, share in ((np.hypot(*actions[:, -2:].T) < 0.6, 0.25), (actions[:, 0] > 0, 0.5)):
        assert (np.exp(-log_pi) * inner).mean() == pytest.approx(share, abs=0.03)


@pytest.mark.parametrize("drones", [2, 3])
def test_it_is_the_improvement_by_the_values_of_its_guide(drones: int) -> None:
    """Against random actions that are weighed by exp Q: where drones go in the next step."""
    policy, rng = policy_of(drones, 0.6), np.random.default_rng(2)
    game, guide = policy.game, policy.guide
    state = np.array([0.6, 0.45, 0.95, 0.5, 0.75, 0.85][: 2 * drones])
    radii, angles = np.sqrt(rng.random((200_000, drones))), 2 * np.pi * rng.random((200_000, drones))
    actions = 1.2 * (radii[..., None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)).reshape(len(radii), -1)
    states = np.tile(state, (len(actions), 1))
    earned = sum((actions[:, 2 * i : 2 * i + 2] ** 2).sum(axis=1) * guide.fields[i].effort for i in range(drones))
    scores = earned + game.discount * guide.values(4, game.step(states, actions))
    weights = np.exp(scores - scores.max())
    expected = weights @ actions / weights.sum()
    drawn = np.concatenate([policy.act(3, states[:2000], rng) for _ in range(10)])
    assert np.abs(expected).max() > 0.2
    assert drawn.mean(axis=0) == pytest.approx(expected, abs=0.03)
    together = (drawn[:, 0] > 0) & (drawn[:, -2] < 0)
    assert together.mean() == pytest.approx(
        weights @ ((actions[:, 0] > 0) & (actions[:, -2] < 0)) / weights.sum(), abs=0.02
    )


@pytest.mark.parametrize(
    ("drones", "late", "most"), [(1, 0.0, 0.2), (2, 0.0, 0.3), (3, 0.0, 3.0), (1, 20.0, 1.2), (2, 20.0, 2.2)]
)
def test_its_flights_earn_what_the_start_is_worth(drones: int, late: float, most: float) -> None:
    """Nearly so where being late is dear: rewards are random, so that drones wait till the last moment.

    What three drones in so small an arena are worth is an estimate by pairs, two nats too high.
    """
    assert -0.2 < policy_of(drones, 0.5, late).gap(1, 600) < most


def test_who_has_arrived_does_nothing() -> None:
    policy, rng = policy_of(2, 0.5), np.random.default_rng(0)
    states = np.tile([1.3, 1.0, 1.0, 0.4], (50, 1))
    actions, log_pi = policy.drawn(4, states, rng)
    assert (actions[:, :2] == 0).all()
    assert (np.hypot(*actions[:, 2:].T) > 0).all()
    states[:, 2:] = [0.2, 0.9]
    assert np.abs(policy.drawn(4, states, rng)[1]).max() < 1e-4
    assert np.ptp(log_pi) > 0.1


def test_it_goes_where_the_policy_of_a_fine_lattice_goes() -> None:
    """Total variation distance of where rollouts spend their time, on squares of 0.25 m."""
    policy = policy_of(1, 0.2, horizon=12)
    game, ((reward, theta), (_, omega)) = policy.game, policy.guide.rewards
    fine = LatticePlanner(game, reward, game.dynamics.reach / 7, 0.2).plan(theta, omega)  # type: ignore[arg-type]
    visits = [
        place_visitation(game, drone_rollouts(game, each, 2000, np.random.default_rng(9)), 0.25)
        for each in (fine, policy, policy_of(1, 500.0, horizon=12))
    ]
    assert visitation_distance(visits[1:]) > 0.3
    assert visitation_distance(visits[:2]) < 0.1


@pytest.mark.parametrize("drones", [2, 3])
def test_the_same_arguments_give_the_same_bits_and_nothing_is_remembered(drones: int) -> None:
    game = arena(drones)
    reward = LinearDroneReward(game)
    planner, theta, omega = (
        GuidedPlanner.of(game, reward, 0.5),
        np.ones(reward.size),
        np.full(len(game.cost_features.names), -0.3),
    )

    def flown(previous: GuidedPolicy | None) -> tuple[bytes, GuidedPolicy]:
        policy = planner.plan(theta, omega, previous, np.random.default_rng(3))
        return drone_rollouts(game, policy, 5, np.random.default_rng(4)).states.tobytes(), policy

    first, policy = flown(None)
    assert planner.state_dict(policy) == {}
    assert flown(policy)[0] == first == flown(None)[0]


def crowd() -> DroneGame:
    """Ten drones, whose 45 pairs do not fit into memory."""
    places = [(0.5 + 0.7 * i, 0.5) for i in range(10)]
    drones = [{"start": at, "goal_region": {"centre": (at[0], 7.0), "radius": 0.3}} for at in places]
    return DroneGame(
        DroneSettings.model_validate({**ARENA, "arena": (7.5, 7.5), "obstacles": [], "drones": drones, "horizon": 20})
    )


def test_whose_networks_exact_values_replace() -> None:
    settings = SoftActorCriticSettings(kind="soft_actor_critic")
    cases: list[tuple[DroneGame, bool]] = [*((arena(n), True) for n in (1, 2, 3)), (double(2), False), (crowd(), False)]
    for game, guided in cases:
        planner = build_soft_actor_critic(settings, game, LinearDroneReward(game))
        assert isinstance(planner, GuidedPlanner) == guided
        if guided:
            assert isinstance(planner.guidance.planner, LatticePlanner)
    unguided = SoftActorCriticSettings(kind="soft_actor_critic", guide="none")
    assert not isinstance(build_soft_actor_critic(unguided, arena(2), LinearDroneReward(arena(2))), GuidedPlanner)


def test_who_asks_for_values_where_there_are_none_is_told_why() -> None:
    settings = SoftActorCriticSettings(kind="soft_actor_critic", guide="lattice")
    check_soft_actor_critic(settings, arena(3))
    for game, why in ((double(3), "double_integrators.*guide to none"), (crowd(), "45 pairs.*expected at most")):
        with pytest.raises(ExperimentError, match=why):
            check_soft_actor_critic(settings, game)
