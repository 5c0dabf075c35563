"""A window and a running mean against means over stacked trajectories; what checkpoints hold of them."""

from collections.abc import Callable

import numpy as np
import pytest
from arenas import arena, random_rollouts
from experiments import demonstrations, experiment
from games import hallway, patrol, square

from mabirds_core.algorithm import memory as memory_module
from mabirds_core.algorithm.memory import Memory, RunningMean, WindowMemory, stacked
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.errors import CheckpointError
from mabirds_core.experiment.assembly import build_game, build_learner, build_memory
from mabirds_core.experiment.learning_settings import MAX_WINDOW
from mabirds_core.games.drones.rewards import LinearDroneReward
from mabirds_core.games.interface import ConstrainedMarkovGame, Trajectories, discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.occupancy import rollouts
from mabirds_core.planners.soft_bellman import soft_bellman_policy
from mabirds_core.rewards.models import LinearReward, NeuralReward, RewardModel, SummableReward, TrueReward

MakeReward = Callable[[PatrolGame], SummableReward]


def uniform_rollouts(game: PatrolGame, count: int, seed: int) -> Trajectories:
    uniform = soft_bellman_policy(game, np.zeros((game.n_states, game.n_actions)))
    return rollouts(game, uniform, count, np.random.default_rng(seed))


def batches(game: PatrolGame, rows: tuple[int, ...] = (1, 1, 1, 1, 1)) -> list[Trajectories]:
    """Demonstrations of some iterations."""
    return [uniform_rollouts(game, count, seed) for seed, count in enumerate(rows)]


def beginning_at(game: PatrolGame, starts: list[int]) -> list[Trajectories]:
    """One demonstration per iteration, begun at the first or second joint start of the game."""
    shown, begun = uniform_rollouts(game, 1, seed=0), np.flatnonzero(game.initial_distribution)
    return [Trajectories(np.insert(shown.states[:, 1:], 0, begun[start], axis=1), shown.actions) for start in starts]


def linear(game: PatrolGame) -> SummableReward:
    return LinearReward(game.reward_features)


def neural(game: PatrolGame) -> SummableReward:
    return NeuralReward(game.reward_features, 3, 2.0, game.n_experts)


def given(game: PatrolGame) -> SummableReward:
    return TrueReward(game)


every_reward = pytest.mark.parametrize("make", [linear, neural, given])


def some_theta(reward: RewardModel) -> Vector:
    return np.random.default_rng(4).normal(size=reward.size)


def at(theta: Vector) -> Parameters:
    """With an omega that linear costs do not look at."""
    return Parameters(theta, np.zeros(0))


def brute_mean(
    game: ConstrainedMarkovGame, reward: RewardModel, theta: Vector, shown: list[Trajectories]
) -> Parameters:
    """Means of grad J and mu, one trajectory after the other."""
    everything, totals = stacked(shown), []
    for states, actions in zip(*everything, strict=True):
        visitation = discounted_visitation(Trajectories(states[None], actions[None]), game.discount)
        totals.append((reward.gradient(theta, visitation), game.cost_features.total(visitation)))
    return Parameters(*(np.mean(parts, axis=0) for parts in zip(*totals, strict=True)))


def assert_close(parameters: Parameters, expected: Parameters) -> None:
    np.testing.assert_allclose(parameters.theta, expected.theta, rtol=0, atol=1e-12)
    np.testing.assert_allclose(parameters.omega, expected.omega, rtol=0, atol=1e-12)


def filled(memory: Memory, shown: list[Trajectories]) -> Memory:
    for demonstrations_of_iteration in shown:
        memory = memory.add(demonstrations_of_iteration)
    return memory


@every_reward
@pytest.mark.parametrize("length", [1, 3, 9])
def test_a_window_observes_the_mean_of_its_newest_demonstrations(make: MakeReward, length: int) -> None:
    game = hallway()
    reward, shown = make(game), batches(game)
    memory, theta = WindowMemory(game, reward, length), some_theta(reward)
    for n, demonstration in enumerate(shown, start=1):
        memory = memory.add(demonstration)
        recent = shown[max(0, n - length) : n]
        assert_close(memory.observed(at(theta)), brute_mean(game, reward, theta, recent))
        assert memory.fill == min(n, length) / length
        np.testing.assert_array_equal(memory.starts, stacked(recent[::-1]).states[:, 0])
        np.testing.assert_array_equal(memory.examples.actions, stacked(recent[::-1]).actions)


@every_reward
def test_a_running_mean_observes_what_a_window_of_all_iterations_does(make: MakeReward) -> None:
    game = hallway()
    reward, shown = make(game), batches(game)
    theta, memory = some_theta(reward), RunningMean.empty(game, reward)
    for n, demonstration in enumerate(shown, start=1):
        memory = memory.add(demonstration)
        window = filled(WindowMemory(game, reward, n), shown[:n])
        assert_close(memory.observed(at(theta)), window.observed(at(theta)))
        assert_close(memory.observed(at(theta)), brute_mean(game, reward, theta, shown[:n]))
        assert memory.fill == window.fill == 1.0
        np.testing.assert_array_equal(np.sort(memory.starts), np.sort(window.starts))
        assert memory.examples is demonstration


def test_every_demonstration_counts_once_however_many_come_together() -> None:
    game, rows = hallway(), (1, 4, 2)
    reward = linear(game)
    shown = batches(game, rows)
    memory = filled(RunningMean.empty(game, reward), shown)
    assert isinstance(memory, RunningMean)
    assert memory.sums.demonstrations == sum(rows)
    assert_close(memory.observed(at(some_theta(reward))), brute_mean(game, reward, some_theta(reward), shown))


def test_a_running_mean_of_drones_is_the_mean_of_all_flights() -> None:
    game = arena()
    reward = LinearDroneReward(game)
    shown = [random_rollouts(game, count, seed) for seed, count in enumerate((1, 3, 1))]
    theta, memory = some_theta(reward), filled(RunningMean.empty(game, reward), shown)
    assert_close(memory.observed(at(theta)), brute_mean(game, reward, theta, shown))
    np.testing.assert_array_equal(memory.starts, stacked(shown).states[:, 0])


def test_starts_are_kept_as_often_as_they_came_in_the_order_in_which_they_came_first() -> None:
    game = hallway()
    first, second = np.flatnonzero(game.initial_distribution)[[1, 0]]
    memory = filled(RunningMean.empty(game, linear(game)), beginning_at(game, [1, 0, 1, 1, 0]))
    assert isinstance(memory, RunningMean)
    np.testing.assert_array_equal(memory.sums.starts, [first, second])
    np.testing.assert_array_equal(memory.sums.start_counts, [3, 2])
    np.testing.assert_array_equal(memory.starts, [first, first, first, second, second])


def test_of_many_different_starts_the_newest_are_kept(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(memory_module, "MAX_STARTS", 4)
    game = arena()
    shown = [random_rollouts(game, count, seed) for seed, count in enumerate((3, 1, 2))]
    memory = filled(RunningMean.empty(game, LinearDroneReward(game)), [*shown, shown[-1]])
    assert isinstance(memory, RunningMean)
    np.testing.assert_array_equal(memory.sums.starts, stacked(shown).states[2:, 0])
    np.testing.assert_array_equal(memory.sums.start_counts, [1, 1, 2, 2])
    assert memory.sums.demonstrations == 8


def test_adding_leaves_a_memory_as_it_was() -> None:
    game = hallway()
    for empty in (RunningMean.empty(game, linear(game)), WindowMemory(game, linear(game), 3)):
        memory = filled(empty, batches(game, (1, 1)))
        before = {name: values.copy() for name, values in memory.to_arrays().items()}
        memory.add(uniform_rollouts(game, 1, seed=7))
        assert_same_arrays(memory.to_arrays(), before)


def assert_same_arrays(arrays: dict[str, Array], expected: dict[str, Array]) -> None:
    assert arrays.keys() == expected.keys()
    for name, values in arrays.items():
        assert values.tobytes() == expected[name].tobytes(), name


@every_reward
@pytest.mark.parametrize("count", [0, 1, 4])
def test_a_running_mean_goes_on_from_its_arrays_bit_for_bit(make: MakeReward, count: int) -> None:
    game = hallway()
    empty, shown = RunningMean.empty(game, make(game)), batches(game)
    memory = filled(empty, shown[:count])
    arrays = memory.to_arrays()
    assert {values.dtype for values in arrays.values()} == {np.dtype(np.float64)}
    restored = empty.from_arrays({**arrays, "theta": np.zeros(3)})
    assert_same_arrays(restored.to_arrays(), arrays)
    after, expected = restored.add(shown[count]), memory.add(shown[count])
    assert_same_arrays(after.to_arrays(), expected.to_arrays())
    assert after.starts.dtype == expected.starts.dtype
    same = (of.observed(at(some_theta(make(game)))) for of in (after, expected))
    assert all(a.tobytes() == b.tobytes() for a, b in zip(*same, strict=True))


@pytest.mark.parametrize("count", [0, 1, 2])
def test_a_running_mean_of_drones_goes_on_from_its_arrays_bit_for_bit(count: int) -> None:
    game = arena()
    empty = RunningMean.empty(game, LinearDroneReward(game))
    shown = [random_rollouts(game, 2, seed) for seed in range(3)]
    memory = filled(empty, shown[:count])
    restored = empty.from_arrays(memory.to_arrays())
    assert_same_arrays(restored.add(shown[count]).to_arrays(), memory.add(shown[count]).to_arrays())


@pytest.mark.parametrize("length", [1, 3])
def test_a_window_goes_on_from_its_arrays_without_the_oldest(length: int) -> None:
    game = hallway()
    empty, shown = WindowMemory(game, linear(game), length), batches(game)
    memory = filled(empty, shown[:4])
    arrays = memory.to_arrays()
    names = {f"recent.{k}.{part}" for k in range(length - 1) for part in ("states", "actions")}
    assert arrays.keys() == names
    restored = empty.from_arrays(arrays)
    assert isinstance(restored, WindowMemory)
    assert len(restored.newest) == length - 1
    assert_same_arrays(restored.add(shown[4]).to_arrays(), memory.add(shown[4]).to_arrays())


STATES = "observed.starts: expected numbers of states below 36"
COUNTS = "observed.start_counts: expected whole numbers from 1, in sum at most the demonstrations"
NUMBER = "observed.demonstrations: expected one whole number"
DAMAGED = [
    ("reward", np.zeros(3), "observed.reward: expected 48 finite numbers"),
    ("reward", np.full(48, np.nan), "observed.reward: expected 48 finite numbers"),
    ("cost", np.zeros((14, 1)), "observed.cost: expected 14 finite numbers"),
    ("cost", np.full(14, np.inf), "observed.cost: expected 14 finite numbers"),
    ("demonstrations", np.array(3.0), NUMBER),
    ("demonstrations", np.array([3.0, 3.0]), NUMBER),
    ("demonstrations", np.array([2.5]), NUMBER),
    ("demonstrations", np.array([-1.0]), NUMBER),
    ("demonstrations", np.array([np.nan]), NUMBER),
    ("demonstrations", np.array([np.inf]), NUMBER),
    ("demonstrations", np.array([2.0]), COUNTS),
    ("start_counts", np.array([[1.0, 2.0]]), COUNTS),
    ("start_counts", np.array([0.0, 2.0]), COUNTS),
    ("start_counts", np.array([1.5, 1.5]), COUNTS),
    ("start_counts", np.array([1.0, np.nan]), COUNTS),
    ("start_counts", np.array([1.0, np.inf]), COUNTS),
    ("start_counts", np.array([2.0, 2.0]), COUNTS),
    ("start_counts", np.array([3.0]), "observed.starts: expected 1, as many as there are start_counts"),
    ("starts", np.array([2.0]), "observed.starts: expected 2, as many as there are start_counts"),
    ("starts", np.array(2.0), "observed.starts: expected 2, as many as there are start_counts"),
    ("starts", np.array([[2.0], [1.0]]), STATES),
    ("starts", np.array([2.0, 36.0]), STATES),
    ("starts", np.array([2.0, -1.0]), STATES),
    ("starts", np.array([2.0, 0.5]), STATES),
    ("starts", np.array([2.0, np.nan]), STATES),
]


@pytest.mark.parametrize(("name", "values", "words"), DAMAGED)
def test_damaged_sums_are_refused_by_name(name: str, values: Array, words: str) -> None:
    game = hallway()
    empty = RunningMean.empty(game, linear(game))
    arrays = filled(empty, beginning_at(game, [1, 0, 0])).to_arrays()
    assert arrays["observed.start_counts"].tolist() == [1.0, 2.0]
    with pytest.raises(CheckpointError) as refusal:
        empty.from_arrays({**arrays, f"observed.{name}": values})
    assert str(refusal.value) == words


@pytest.mark.parametrize("name", ["demonstrations", "reward", "cost", "starts", "start_counts"])
def test_a_missing_sum_is_refused_by_name(name: str) -> None:
    game = hallway()
    empty = RunningMean.empty(game, linear(game))
    arrays = empty.to_arrays()
    del arrays[f"observed.{name}"]
    with pytest.raises(CheckpointError, match=r"observed: expected arrays .*'start_counts'\], found \[") as refusal:
        empty.from_arrays(arrays)
    assert repr(name) not in str(refusal.value).split("found")[1]


@pytest.mark.parametrize(
    "values", [np.zeros((1, 3)), np.zeros(4), np.full((1, 4), np.nan), np.zeros((1, 4, 1)), np.array(1.0)]
)
def test_starts_of_drones_are_joint_states(values: Array) -> None:
    game = arena()
    empty = RunningMean.empty(game, LinearDroneReward(game))
    arrays = empty.add(random_rollouts(game, 1)).to_arrays()
    with pytest.raises(CheckpointError, match="observed.starts: expected 1"):
        empty.from_arrays({**arrays, "observed.starts": values})


def test_sums_of_another_game_are_refused() -> None:
    game, other = hallway(), square()
    arrays = filled(RunningMean.empty(other, linear(other)), batches(other, (1,))).to_arrays()
    with pytest.raises(CheckpointError, match="observed.reward: expected 48"):
        RunningMean.empty(game, linear(game)).from_arrays(arrays)


def test_the_window_of_an_experiment_is_a_length_or_all() -> None:
    settings = experiment({"algorithm.window": "all"})
    assert isinstance(build_learner(settings, "ann").memory, RunningMean)
    memory = build_learner(experiment({"algorithm.window": 7}), "ann").memory
    assert isinstance(memory, WindowMemory)
    assert memory.length == 7


class RewardOfTrajectories:
    """A reward whose gradient needs the demonstrations themselves."""

    size = 2

    def initial(self, rng: np.random.Generator) -> Vector:
        return rng.normal(size=2)


def test_where_the_gradient_needs_the_demonstrations_themselves_all_means_the_newest_of_them() -> None:
    """The mean is over those there are: nothing counts as zero."""
    settings = experiment({"algorithm.window": "all"})
    game = build_game(settings)
    reward: RewardModel = RewardOfTrajectories()  # type: ignore[assignment]
    memory = build_memory(settings, game, reward)
    assert memory == WindowMemory(game, reward, MAX_WINDOW, padded=False)
    assert build_memory(experiment({"algorithm.window": 20}), game, reward) == WindowMemory(game, reward, 20)


def test_a_window_without_padding_observes_what_a_running_mean_does() -> None:
    game = hallway()
    reward, shown = neural(game), batches(game, (1, 2, 1))
    window, mean = WindowMemory(game, reward, 9, padded=False), RunningMean.empty(game, reward)
    for demonstration in shown:
        window, mean = window.add(demonstration), mean.add(demonstration)
        assert window.fill == mean.fill == 1.0
        assert_close(window.observed(at(some_theta(reward))), mean.observed(at(some_theta(reward))))
    assert not window.from_arrays({}).padded


def test_the_size_of_a_running_mean_does_not_grow_with_the_demonstrations() -> None:
    settings = experiment({"algorithm.window": "all"})
    memory, sizes = build_learner(settings, "ann").memory, set()
    for demonstration in demonstrations(settings)["ann"]:
        memory = memory.add(demonstration)
        sizes.add(sum(values.size for values in memory.to_arrays().values()))
    assert len(sizes) == 1


def test_a_game_of_one_start_keeps_one() -> None:
    game = patrol("..\n..", [((0, 0), (1, 1))], ((1, 1), (0, 0)))
    memory = filled(RunningMean.empty(game, linear(game)), batches(game))
    assert isinstance(memory, RunningMean)
    assert memory.sums.start_counts.tolist() == [5]
