"""Algorithm 1's update against a naive re-computation of its equations, and what an update may depend on."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
from games import SlowPatrol, hallway

from mabirds_core.algorithm.gradient import GradientEstimator
from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.memory import WindowMemory
from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Indices, Vector
from mabirds_core.consensus.generators import complete_edges, static
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways
from mabirds_core.consensus.strict import StrictMixer, StrictState
from mabirds_core.errors import DivergenceError, ScheduleError
from mabirds_core.games.interface import Trajectories, Visitation, discounted_visitation
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_core.planners.interface import OccupancyEstimator, Policy
from mabirds_core.planners.occupancy import SampledOccupancy, rollouts
from mabirds_core.planners.soft_bellman import SoftBellmanPlanner, soft_bellman_policy
from mabirds_core.rewards.models import LinearReward

STEPS = PaperSteps(alpha=3.0, beta=0.7, eta1=0.6, eta2=0.9)
SLOTS = (both_ways([(0, 1), (1, 2)]), both_ways([(0, 2)]), frozenset({(0, 1), (1, 2), (2, 0)}))
NAMES = ("a", "b", "c")
SCHEDULE = EdgeSchedule(NAMES, SLOTS)
WEIGHTS: list[list[list[float]]] = [
    [[2 / 3, 1 / 3, 0], [1 / 3, 1 / 3, 1 / 3], [0, 1 / 3, 2 / 3]],
    [[1 / 2, 0, 1 / 2], [0, 1, 0], [1 / 2, 0, 1 / 2]],
    [[1 / 2, 0, 1 / 2], [1 / 2, 1 / 2, 0], [0, 1 / 2, 1 / 2]],
]
"""W of the three slots, by hand: a line a - b - c, then a - c, then the directed ring a -> b -> c -> a."""


@dataclass(frozen=True)
class GivenRollouts:
    """An expectation over trajectories that are known beforehand."""

    game: PatrolGame
    trajectories: Trajectories

    def __call__(self, policy: Policy, rng: np.random.Generator, starts: Indices | None = None) -> Visitation:
        return discounted_visitation(self.trajectories, self.game.discount)


def some_trajectories(game: PatrolGame, count: int, seed: int) -> Trajectories:
    uniform = soft_bellman_policy(game, np.zeros((game.n_states, game.n_actions)))
    return rollouts(game, uniform, count, np.random.default_rng(seed))


def learner(index: int, window: int = 1, seed: int = 5, expectation: OccupancyEstimator | None = None) -> Learner:
    game = hallway()
    reward = LinearReward(game.reward_features)
    planner = SoftBellmanPlanner(game, reward, game.cost_features)
    sampled = expectation or SampledOccupancy(game, 4)
    estimator = GradientEstimator(game, reward, planner, sampled, "initial")
    return Learner(index, estimator, StrictMixer(NAMES[index], SCHEDULE), STEPS, estimator.window(window), seed)


def random_parameters(seed: int) -> Parameters:
    game, rng = hallway(), np.random.default_rng(seed)
    sizes = len(game.reward_features.names), len(game.cost_features.names)
    return Parameters(rng.normal(size=sizes[0]), rng.normal(size=sizes[1]))


def state_at(iteration: int, parameters: Parameters, window: int = 1) -> LearnerState:
    return LearnerState(iteration, StrictState(parameters), learner(0, window).memory, {})


def newest(state: LearnerState) -> tuple[Trajectories, ...]:
    """The demonstrations of its window."""
    assert isinstance(state.memory, WindowMemory)
    return state.memory.newest


def neighbours_of(index: int, iteration: int) -> dict[str, Parameters]:
    """Parameters of all learners, restricted to the in-neighbours of the iteration."""
    return {NAMES[u]: random_parameters(u) for u in SCHEDULE.in_neighbours(index, iteration)}


def naive_totals(game: PatrolGame, trajectories: Trajectories) -> Parameters:
    """mean_j grad J(zeta^j) and mean_j mu(zeta^j), feature by feature and step by step."""
    slow = SlowPatrol(game.settings)
    sums = [np.zeros(len(game.reward_features.names)), np.zeros(len(game.cost_features.names))]
    for states, actions in zip(*trajectories, strict=True):
        for step, (s, a) in enumerate(zip(states, actions, strict=True)):
            pair, weight = (slow.states[s], slow.actions[a]), game.discount**step
            sums[0] += weight * np.array(slow.reward_features(*pair))
            sums[1] += weight * np.array(slow.cost_features(*pair))
    count = len(trajectories.states)
    return Parameters(sums[0] / count, sums[1] / count)


def naive_update(
    game: PatrolGame, index: int, n: int, known: dict[int, Parameters], imagined: Trajectories,
    demonstrations: dict[int, Trajectories], window: int,
) -> Parameters:  # fmt: skip
    """The two lines of step 4; ``demonstrations[k]`` is zeta(k)."""
    row = WEIGHTS[(n - 1) % 3][index]
    after = []
    for part, step in ((0, 0.7 / n**0.9), (1, 3.0 / n**0.6)):
        mixed = sum(row[u] * known[u][part] for u in known)
        terms = [
            naive_totals(game, imagined)[part] - naive_totals(game, demonstrations[n - i])[part]
            for i in range(window)
            if n - i > 0
        ]
        after.append(mixed - step / window * sum(terms))
    return Parameters(*after)


def assert_same_bits(one: Parameters, other: Parameters) -> None:
    assert one.theta.tobytes() == other.theta.tobytes()
    assert one.omega.tobytes() == other.omega.tobytes()


@pytest.mark.parametrize("index", [0, 1, 2])
@pytest.mark.parametrize("window", [1, 3])
def test_five_updates_are_those_of_the_papers_equations(index: int, window: int) -> None:
    game = hallway()
    demonstrations = {n: some_trajectories(game, 1, seed=n) for n in range(1, 6)}
    state = state_at(1, random_parameters(index), window)
    for n in range(1, 6):
        imagined = some_trajectories(game, 4, seed=100 + n)
        neighbours = neighbours_of(index, n)
        known = {**{NAMES.index(name): given for name, given in neighbours.items()}, index: state.parameters}
        expected = naive_update(game, index, n, known, imagined, demonstrations, window)
        one = learner(index, window, expectation=GivenRollouts(game, imagined))
        state = one.step(state, demonstrations[n], neighbours).state
        np.testing.assert_allclose(state.parameters.theta, expected.theta, rtol=0, atol=1e-12)
        np.testing.assert_allclose(state.parameters.omega, expected.omega, rtol=0, atol=1e-12)
        assert state.iteration == n + 1


def test_an_update_uses_rollouts_of_the_policy_of_its_own_parameters_and_generator() -> None:
    game = hallway()
    one, own, demonstration = (
        learner(index=1, seed=5),
        random_parameters(9),
        some_trajectories(game, 1, seed=1),
    )
    policy = one.estimator.planner.plan(*own)
    imagined = rollouts(game, policy, 4, np.random.default_rng([5, 1, 2]))
    found = one.step(state_at(2, own), demonstration, {}).gradient
    both = naive_totals(game, imagined), naive_totals(game, demonstration)
    expected = [mean - observed for mean, observed in zip(*both, strict=True)]
    np.testing.assert_allclose(found.theta, expected[0], rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.omega, expected[1], rtol=0, atol=1e-12)


def test_a_state_remembers_the_last_demonstrations_newest_first() -> None:
    game, one = hallway(), learner(index=1, window=3)
    demonstrations = [some_trajectories(game, 1, seed=n) for n in range(4)]
    state = one.initial_state()
    for n, demonstration in enumerate(demonstrations, start=1):
        assert len(newest(state)) == min(n - 1, 3)
        state = one.step(state, demonstration, neighbours_of(1, n)).state
    assert [id(demonstration) for demonstration in newest(state)] == [id(demonstrations[k]) for k in (3, 2, 1)]


def test_every_learner_starts_from_the_same_zeros() -> None:
    for index in range(3):
        state = learner(index).initial_state()
        assert (state.iteration, newest(state), state.rule) == (1, (), {})
        assert not state.parameters.theta.any()
        assert not state.parameters.omega.any()
        assert state.parameters.theta.shape == random_parameters(0).theta.shape
        assert state.parameters.omega.shape == random_parameters(0).omega.shape


def test_learners_built_twice_agree_bit_for_bit() -> None:
    demonstration = some_trajectories(hallway(), 1, seed=1)
    first, second = (learner(1).step(learner(1).initial_state(), demonstration, neighbours_of(1, 1)) for _ in range(2))
    assert_same_bits(first.state.parameters, second.state.parameters)
    assert_same_bits(first.gradient, second.gradient)


def gradient_of(index: int, iteration: int, seed: int) -> Vector:
    """Gradient in theta from one set of parameters and one demonstration."""
    state, demonstration = (
        state_at(iteration, random_parameters(7)),
        some_trajectories(hallway(), 1, seed=1),
    )
    neighbours = neighbours_of(index, iteration)
    return learner(index, seed=seed).step(state, demonstration, neighbours).gradient.theta


@pytest.mark.parametrize(("index", "iteration", "seed"), [(1, 4, 5), (0, 5, 5), (0, 4, 6), (1, 1, 5)])
def test_another_learner_iteration_or_seed_draws_others(index: int, iteration: int, seed: int) -> None:
    assert (gradient_of(0, 4, 5) == gradient_of(0, 4, 5)).all()
    assert (gradient_of(index, iteration, seed) != gradient_of(0, 4, 5)).any()


def test_all_learners_and_iterations_of_a_network_draw_differently() -> None:
    game, draws = hallway(), []
    demonstration = some_trajectories(game, 1, seed=1)

    def recorded(policy: Policy, rng: np.random.Generator, starts: Indices | None = None) -> Visitation:
        draws.append(rng.random())
        return discounted_visitation(demonstration, game.discount)

    for index in range(3):
        one = learner(index, expectation=recorded)
        for n in range(1, 21):
            one.step(state_at(n, random_parameters(index)), demonstration, neighbours_of(index, n))
    assert len(set(draws)) == len(draws) == 60


def test_mixing_does_not_move_parameters_on_which_all_agree() -> None:
    """Where the demonstration is what is imagined the gradient vanishes, and W 1 = 1 leaves the rest."""
    game, same = hallway(), random_parameters(3)
    demonstration = some_trajectories(game, 1, seed=1)
    one = learner(1, expectation=GivenRollouts(game, demonstration))
    result = one.step(state_at(1, same), demonstration, {"a": same, "c": same})
    assert not result.gradient.theta.any()
    assert not result.gradient.omega.any()
    np.testing.assert_allclose(result.state.parameters.theta, same.theta, atol=1e-15)
    np.testing.assert_allclose(result.state.parameters.omega, same.omega, atol=1e-15)


def test_the_order_in_which_neighbours_are_given_changes_no_bit() -> None:
    everybody = replace(learner(0), mixer=StrictMixer("a", static(tuple("abcde"), complete_edges(5))))
    state, demonstration = state_at(1, random_parameters(0)), some_trajectories(hallway(), 1, seed=1)
    neighbours = {name: random_parameters(u) for u, name in enumerate("bcde", start=1)}
    backwards = dict(reversed(neighbours.items()))
    first, second = (everybody.step(state, demonstration, given) for given in (neighbours, backwards))
    assert_same_bits(first.state.parameters, second.state.parameters)


@pytest.mark.parametrize("given", ["", "a", "abc", "acd", "cd"])
def test_parameters_of_other_learners_than_the_schedules_are_refused(given: str) -> None:
    neighbours = {name: random_parameters(u) for u, name in enumerate(given)}
    state, demonstration = state_at(4, random_parameters(1)), some_trajectories(hallway(), 1, seed=1)
    with pytest.raises(ScheduleError) as caught:
        learner(1).step(state, demonstration, neighbours)
    assert str(caught.value) == f"iteration 4: parameters of learners {list(given)}, expected ['a', 'c']"


def test_parameters_over_a_closed_edge_are_refused() -> None:
    state, demonstration = state_at(2, random_parameters(1)), some_trajectories(hallway(), 1, seed=1)
    with pytest.raises(ScheduleError, match=r"iteration 2: .*\['a', 'c'\], expected \[\]"):
        learner(1).step(state, demonstration, neighbours_of(1, 1))


def test_an_update_leaves_what_it_was_given_as_it_was() -> None:
    state, demonstration = state_at(1, random_parameters(1), window=2), some_trajectories(hallway(), 1, seed=1)
    neighbours = neighbours_of(1, 1)
    learner(1, window=2).step(state, demonstration, neighbours)
    assert_same_bits(state.parameters, random_parameters(1))
    assert newest(state) == ()
    for name, parameters in neighbours.items():
        assert_same_bits(parameters, random_parameters(NAMES.index(name)))


def test_a_longer_window_over_one_repeated_demonstration_changes_nothing() -> None:
    game, demonstration = hallway(), some_trajectories(hallway(), 1, seed=1)
    single = learner(1, expectation=GivenRollouts(game, some_trajectories(game, 4, seed=2)))
    state, window = state_at(5, random_parameters(1)), learner(1, window=3).memory
    repeated = state._replace(memory=window.add(demonstration).add(demonstration))
    first, second = single.step(state, demonstration, {}), single.step(repeated, demonstration, {})
    np.testing.assert_allclose(first.gradient.theta, second.gradient.theta, atol=1e-13)
    np.testing.assert_allclose(first.gradient.omega, second.gradient.omega, atol=1e-13)


def test_parameters_that_leave_the_range_of_numbers_are_refused_with_a_remedy() -> None:
    wild = replace(learner(0), steps=PaperSteps(alpha=1e120, beta=1.0))
    demonstration = some_trajectories(hallway(), 1, seed=0)
    with pytest.raises(DivergenceError, match="step 1 carried .* past 1e[+]12; lower alpha and beta"):
        wild.step(wild.initial_state(), demonstration, neighbours_of(0, 1))
