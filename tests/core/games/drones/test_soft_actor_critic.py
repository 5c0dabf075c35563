"""Soft actor-critic: its densities, replay and memory, that it repeats, and how near it comes to the lattice."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import torch
from arenas import arena, double, random_rollouts

from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError, ExperimentError
from mabirds_core.games.drones.actor_critic_networks import MODES, Adam, Networks
from mabirds_core.games.drones.actor_critic_policy import Problem
from mabirds_core.games.drones.game import DroneGame
from mabirds_core.games.drones.lattice import LatticePlanner
from mabirds_core.games.drones.metrics import place_visitation, visitation_distance
from mabirds_core.games.drones.mixtures import Mixture, squashed
from mabirds_core.games.drones.replay import Replay
from mabirds_core.games.drones.rewards import LinearDroneReward, TrueDroneReward
from mabirds_core.games.drones.rollouts import drone_rollouts
from mabirds_core.games.drones.settings import DroneSettings
from mabirds_core.games.drones.soft_actor_critic import SacPlanner, SacPolicy

SMALL = {"hidden": 8, "steps": 4, "first_steps": 6, "batch": 8, "capacity": 200, "rollouts": 3}


def planner(game: DroneGame, temperature: float = 0.1, **changes: object) -> SacPlanner:
    return SacPlanner(game, TrueDroneReward(game), temperature, **{**SMALL, **changes})  # type: ignore[arg-type]


def found(one: SacPlanner, previous: SacPolicy | None = None, seed: int = 0, omega: float = -0.1) -> SacPolicy:
    weights = np.full(len(one.game.cost_features.names), omega)
    return one.plan(np.zeros(0), weights, previous, np.random.default_rng(seed), random_rollouts(one.game, 2, seed))


def bits(one: SacPlanner, policy: SacPolicy) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in one.state_dict(policy).items()}


@pytest.mark.parametrize("deviation", [0.3, 0.7, 1.2])
def test_the_density_of_squashed_actions_has_mass_one(deviation: float) -> None:
    """Over the unit disc, by the midpoint rule in polar coordinates, for u from a Gaussian off the middle."""
    radii, angles = (np.arange(2000) + 0.5) / 2000, 2 * np.pi * (np.arange(360) + 0.5) / 360
    reach = np.arctanh(radii)[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    u = torch.from_numpy(reach)
    actions, log_determinant = squashed(u)
    assert np.allclose(np.hypot(*np.moveaxis(actions.numpy(), -1, 0)), radii[:, None], atol=1e-4)
    away = ((u - torch.tensor([0.4, -0.2])) ** 2).sum(-1) / (2 * deviation**2)
    density = torch.exp(-away - log_determinant) / (2 * np.pi * deviation**2)
    mass = (density.numpy() * radii[:, None]).sum() / 2000 * 2 * np.pi / 360
    assert mass == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("length", [1e-4, 0.3, 2.0, 6.0])
def test_the_determinant_is_that_of_the_map(length: float) -> None:
    u = torch.tensor([0.6 * length, 0.8 * length], dtype=torch.float64)
    jacobian = torch.autograd.functional.jacobian(lambda x: squashed(x)[0], u)
    assert float(squashed(u)[1]) == pytest.approx(float(torch.linalg.det(jacobian).log()), abs=2e-3)


def test_long_vectors_have_finite_densities() -> None:
    actions, log_determinant = squashed(torch.tensor([[80.0, 0.0], [0.0, 0.0]]))
    assert torch.isfinite(log_determinant).all()
    assert actions.norm(dim=-1).max() <= 1.0


@pytest.mark.parametrize("game", [arena(3), double(3)], ids=["single", "double"])
def test_torch_moves_drones_as_numpy_does(game: DroneGame) -> None:
    rollouts = random_rollouts(game, 200)
    states, actions = rollouts.states.reshape(-1, game.state_size), 2 * rollouts.actions.reshape(-1, game.action_size)
    dynamics = game.dynamics.on("cpu", torch.float64)
    after = dynamics.step(torch.from_numpy(game.drones(states)), torch.from_numpy(game.controls(actions)))
    assert np.abs(after.numpy().reshape(states.shape) - game.step(states, actions)).max() < 1e-12


def random_mixture(drones: int, rows: int, seed: int = 0) -> Mixture:
    """The same mixture in every row, of modes that differ."""
    output = torch.from_numpy(np.random.default_rng(seed).normal(0, 0.5, size=(1, 3 * (1 + 5 * drones))))
    return Mixture(*(values.expand(rows, *values.shape[1:]) for values in Mixture.of(output, 3)))


def drawn(mixture: Mixture, seed: int) -> tuple[Array, Array]:
    """One action of every row, and log pi."""
    rng, (rows, modes, drones, _) = np.random.default_rng(seed), mixture.means.shape
    noise = torch.from_numpy(rng.standard_normal((rows, modes, 2 * drones)))
    actions, log_pi = mixture.act(mixture.chosen(mixture.draw(noise), torch.from_numpy(rng.random(rows))))
    return actions[:, 0].numpy(), log_pi[:, 0].numpy()


def test_log_pi_is_relative_to_the_uniform_measure_of_the_disc() -> None:
    """By the midpoint rule, its mass in a smaller disc is the share of actions that are drawn there."""
    radii, angles = 0.7 * np.sqrt((np.arange(300) + 0.5) / 300), 2 * np.pi * (np.arange(360) + 0.5) / 360
    u = np.arctanh(radii)[:, None, None] * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    _, log_pi = random_mixture(1, 1).act(torch.from_numpy(u.reshape(1, -1, 1, 2)))
    mass = 0.49 * np.exp(log_pi.numpy()).mean()
    actions, _ = drawn(random_mixture(1, 200_000), seed=1)
    assert 0.2 < mass < 0.9
    assert (np.hypot(*actions.T) < 0.7).mean() == pytest.approx(mass, abs=0.005)


def test_the_density_of_two_drones_is_that_of_what_is_drawn() -> None:
    """E over actions of exp(-log pi) is the share of the discs that is covered; of two drones in smaller discs."""
    actions, log_pi = drawn(random_mixture(2, 400_000), seed=3)
    for side in (1, -1):  # and of halves, which tells who is who
        inner = (np.hypot(*actions[:, :2].T) < 0.6) & (np.hypot(*actions[:, 2:].T) < 0.6) & (side * actions[:, 3] > 0)
        assert (np.exp(-log_pi) * inner).mean() == pytest.approx(0.36**2 / 2, abs=0.003)


def test_modes_begin_apart() -> None:
    networks = Networks(arena(1), 16)
    weights = networks.initial_actor(np.random.default_rng(0))
    mixture = networks.mixture(weights, torch.zeros(1, 2), torch.zeros(1))
    assert mixture.means.shape == (1, MODES, 1, 2)
    assert mixture.means.std(dim=1).min() > 0.1


def test_adam_is_that_of_torch() -> None:
    weights = torch.randn(1, 5, generator=torch.Generator().manual_seed(1))
    expected = weights.clone().requires_grad_()
    optimiser, own = torch.optim.Adam([expected], lr=0.01), Adam.of(weights)
    for _ in range(20):
        optimiser.zero_grad()
        (expected**4).sum().backward()
        optimiser.step()
        own = own.descend(4 * own.weights**3, 0.01)
    assert torch.allclose(own.weights, expected, atol=1e-6)


def test_the_replay_keeps_the_newest_rollouts_and_each_demonstration_once() -> None:
    game = arena(2)  # T + 1 = 4
    first, second = random_rollouts(game, 3, seed=1), random_rollouts(game, 2, seed=2)
    replay = Replay.empty(game).with_rollouts(first, 16).with_rollouts(second, 16)
    assert len(replay.rollouts.states) == 4
    assert (replay.rollouts.states[-2:] == second.states).all()
    assert (replay.rollouts.states[:2] == first.states[1:]).all()
    for _ in range(2):
        replay = replay.with_demonstrations(first, 1000).with_demonstrations(second, 1000)
    assert len(replay.demonstrations.states) == 5
    states, _ = replay.transitions
    assert states.shape == (4 * (4 + 5), game.state_size)
    drawn = replay.draws(5000, 8, 0.25, 0.9, np.random.default_rng(0))
    assert drawn.shape == (5000, 8)
    assert drawn[:, :6].max() < 16 <= drawn[:, 6:].min()
    assert drawn.max() < 36
    shares = np.bincount(drawn.ravel() % 4) / drawn.size
    assert shares == pytest.approx(0.9 ** np.arange(4) / (0.9 ** np.arange(4)).sum(), abs=0.01)


def test_the_same_arguments_give_the_same_bits_and_leave_the_previous_policy_alone() -> None:
    one = planner(arena(2))
    start = found(one)
    before = bits(one, start)
    again, other = found(one, start, seed=1), found(one, start, seed=2)
    assert bits(one, found(one, start, seed=1)) == bits(one, again) != bits(one, other)
    assert bits(one, start) == before != bits(one, again)
    assert (start.searches, again.searches) == (1, 2)


def test_what_is_remembered_goes_on_as_if_nothing_had_happened() -> None:
    one = planner(arena(2))
    policy = found(one, found(one))
    recalled = one.load_state_dict(one.state_dict(policy))
    assert bits(one, found(one, recalled, seed=7)) == bits(one, found(one, policy, seed=7))


@pytest.mark.parametrize(
    ("name", "values"),
    [
        ("targets", np.zeros(3)),
        ("actor.mean", np.zeros((1, 1))),
        ("critics.square", None),
        ("rollouts.states", np.full((1, 4, 4), np.nan)),
        ("counts", np.array([1.5, 1.0, 1.0])),
    ],
)
def test_memory_that_does_not_fit_is_refused_by_name(name: str, values: Array | None) -> None:
    one = planner(arena(2))
    memory = one.state_dict(found(one))
    assert name in memory
    del memory[name]
    with pytest.raises(CheckpointError, match=name):
        one.load_state_dict(memory if values is None else {**memory, name: values})


def test_a_policy_of_another_game_or_size_is_no_start() -> None:
    one, other = planner(arena(2)), planner(arena(2, {"horizon": 4}))
    assert found(one, found(other)).searches == 1
    assert found(one, found(replace(one, hidden=9))).searches == 1
    assert found(one, found(one)).searches == 2


def test_a_gpu_that_is_not_there_is_missed_at_once() -> None:
    if torch.cuda.is_available():
        assert planner(arena(1), device="cuda").device == "cuda"
    else:
        with pytest.raises(ExperimentError, match="device cuda: torch finds no GPU"):
            planner(arena(1), device="cuda")


def problem_of(one: SacPlanner, omega: Array) -> Problem:
    return Problem(one.game, ((one.reward_model, np.zeros(0)), (one.game.cost_features, omega)), 0.1)


def test_nothing_follows_the_last_step() -> None:
    """At t = T what is wanted of Q is what the action itself costs."""
    game = arena(2)
    one = planner(game)
    policy = found(one)
    problem = problem_of(one, np.full(len(game.cost_features.names), -0.3))
    networks, last = Networks(game, 8), 0
    for batch in one._batches(problem, policy.replay, 20, np.random.default_rng(0)):
        wanted, ends = one._wanted(networks, problem, policy.learned, batch), batch.times == game.horizon
        assert torch.equal(wanted[ends], batch.efforts[ends])
        assert not torch.isclose(wanted[~ends], batch.efforts[~ends]).any()
        last += int(ends.sum())
    assert last > 10


def test_rewards_are_those_of_the_newest_parameters() -> None:
    game = arena(2)
    one = planner(game)
    policy, problem = found(one), problem_of(one, np.linspace(-1, 1, len(game.cost_features.names)))
    batch = next(iter(one._batches(problem, policy.replay, 1, np.random.default_rng(0))))
    states, actions = (values.double().numpy() for values in (batch.states, batch.actions))
    idle = np.zeros_like(actions)
    assert np.allclose(batch.efforts.numpy(), problem.reward(states, actions) - problem.reward(states, idle), atol=1e-5)
    followed, after = batch.times.numpy() < game.horizon, game.step(states, actions)
    assert np.allclose(batch.successors.numpy()[followed], after[followed], atol=1e-5)
    assert np.allclose(batch.idle.numpy()[followed], problem.reward(after, idle)[followed], atol=1e-5)
    assert followed.any()


HALL = DroneSettings.model_validate(
    {
        "kind": "drones",
        "arena": (2.0, 2.0),
        "obstacles": [{"centre": (1.25, 0.6), "radius": 0.25}],
        "drones": [{"start": (0.4, 0.4), "start_spread": 0.2, "goal_region": {"centre": (1.7, 1.7), "radius": 0.2}}],
        "horizon": 12,
        "discount": 0.97,
        "step_cost": 0.1,
        "features": {"cost_spacing": 0.5, "cost_width": 0.25, "reward_spacing": 0.5, "reward_width": 0.4},
    }
)
"""One drone, an obstacle beside its way: a Gaussian of actions cannot go round both sides of one at once."""


@cache
def hall() -> tuple[DroneGame, Array, Array]:
    """The game, a reward for being near the goal region, and costs of the obstacle."""
    game = DroneGame(HALL)
    goal = game.reward_features.grid.nodes - [1.7, 1.7]
    theta = 0.3 * np.exp(-(goal**2).sum(axis=1))
    omega = np.zeros(len(game.cost_features.names))
    omega[game.true_constraints] = -0.5
    return game, theta, omega


@pytest.mark.parametrize(("temperature", "searches"), [(0.1, 8), (1000.0, 3)])
def test_it_comes_near_the_lattice(temperature: float, searches: int) -> None:
    """Total variation distance of where rollouts spend their time, on squares of 0.25 m: below 0.12.

    Two sets of 2000 rollouts of one and the same policy differ by about 0.02; the lattice's policy and that of uniform
    actions by more than 0.5 at the lower temperature. At the highest all rewards are nothing and actions are uniform.
    """
    game, theta, omega = hall()
    reward, seeds = LinearDroneReward(game), iter(range(100))
    near = LatticePlanner(game, reward, 0.25 / 7**0.5, temperature).plan(theta, omega)
    one = SacPlanner(game, reward, temperature, hidden=64, first_steps=600, steps=200)
    policy = None
    for _ in range(searches):
        policy = one.plan(theta, omega, policy, np.random.default_rng(next(seeds)))
    assert policy is not None
    visits = [
        place_visitation(game, drone_rollouts(game, each, 2000, np.random.default_rng(9)), 0.25)
        for each in (near, policy)
    ]
    distance = visitation_distance(visits)
    uniform = LatticePlanner(game, reward, 0.25 / 7**0.5, 1000.0).plan(theta, omega)
    idle = place_visitation(game, drone_rollouts(game, uniform, 2000, np.random.default_rng(9)), 0.25)
    if temperature < 1:
        assert visitation_distance([visits[0], idle]) > 0.5
    assert distance < 0.12, distance


def test_the_gap_is_the_critics_own() -> None:
    game = arena(2)
    one = planner(game)
    policy = found(one)
    assert policy.gap(1) == policy.gap(1) != policy.gap(2)
    assert one.load_state_dict(one.state_dict(policy)).gap(1) is None
