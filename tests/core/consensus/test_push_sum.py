"""Running-sum push-sum: nothing is lost, strict mode while all arrives, the same optimum while much does not."""

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import cache
from typing import Any

import numpy as np
import pytest
from experiments import demonstrations, experiment
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.algorithm.paper_steps import PaperSteps
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.consensus.push_sum import PushSumState, RunningSum
from mabirds_core.consensus.push_sum_mixer import PushSumMixer
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.consensus.strict import StrictMixer, StrictState
from mabirds_core.errors import ScheduleError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.simulate import History, simulate

RESILIENT = {"mixing": {"kind": "resilient"}}
SCHEDULES: dict[str, Any] = {
    "static": {"kind": "static"},
    "alternating": {"kind": "alternating"},
    "directed ring": {"kind": "directed_ring"},
    "gossip": {"kind": "gossip", "slots": 8, "seed": 1},
}
FOUR = {"learners": ["ann", "bob", "cid", "dee"]}

numbers = st.floats(-1e6, 1e6, allow_subnormal=False)


@given(st.lists(numbers, max_size=30), st.integers(0, 30))
def test_differences_of_running_sums_are_as_exact_as_single_numbers(values: list[float], earlier: int) -> None:
    sums = [RunningSum.zero(1)]
    for value in values:
        sums.append(sums[-1].plus(np.array([value])))
    start = min(earlier, len(values))
    exact = float(sum(map(Fraction, values[start:]), Fraction(0)))
    scale = sum(map(abs, values), 0.0)
    assert abs(sums[-1].since(sums[start])[0] - exact) <= 1e-15 * abs(exact) + 1e-28 * scale


def test_a_sum_that_has_grown_large_still_gives_small_differences() -> None:
    large = RunningSum.zero(1)
    for _ in range(1000):
        large = large.plus(np.array([1e12 / 3]))
    assert large.plus(np.array([1e-6])).since(large)[0] == pytest.approx(1e-6, rel=1e-9)


def test_push_sum_begins_with_the_estimate_and_the_weight_that_is_brought() -> None:
    parameters = Parameters(np.array([2.0, -4.0]), np.array([6.0]))
    assert PushSumState.init(parameters).mass.tolist() == [2, -4, 6, 1]
    assert PushSumState.init(parameters, initial_weight=0.5).mass.tolist() == [1, -2, 3, 0.5]
    for weight in (1.0, 0.5):
        estimate = PushSumState.init(parameters, weight).estimate()
        assert (estimate.theta.tolist(), estimate.omega.tolist()) == ([2, -4], [6])


def total(states: dict[str, PushSumState]) -> Vector:
    """All mass there is: what learners hold and what is under way."""
    under_way = [
        sent_sum.since(states[receiver].received.get(sender, RunningSum.zero(sent_sum.total.size)))
        for sender, state in states.items()
        for receiver, sent_sum in state.sent.items()
    ]
    return np.sum([state.mass for state in states.values()] + under_way, axis=0)


@given(st.lists(st.tuples(st.booleans(), st.integers(0, 2), st.integers(0, 2), st.floats(0.1, 0.9)), max_size=60))
def test_mass_is_conserved_whatever_is_lost(events: list[tuple[bool, int, int, float]]) -> None:
    names = "abc"
    states = {
        name: PushSumState.init(Parameters(np.array([k, 7.0]), np.array([-k]))) for k, name in enumerate(names, start=1)
    }
    before = total(states)
    for gives, one, other, share in events:
        sender, receiver = names[one], names[other]
        if gives and sender != receiver:
            states[sender] = states[sender].send({receiver: share}, 1 - share)
        elif receiver in states[sender].sent:
            states[receiver] = states[receiver].receive(sender, states[sender].sent[receiver])
    np.testing.assert_allclose(total(states), before, rtol=1e-13)


@pytest.mark.parametrize("schedule", SCHEDULES)
@pytest.mark.parametrize("closing_rounds", [0, 3])
@pytest.mark.parametrize("algorithm", [{}, {"algorithm": {}}], ids=["the paper's steps", "the default rule"])
def test_without_loss_it_is_the_papers_iteration(schedule: str, closing_rounds: int, algorithm: dict[str, Any]) -> None:
    changes = {**FOUR, **algorithm, "schedule": SCHEDULES[schedule], "closing_rounds": closing_rounds}
    strict, resilient = experiment(changes), experiment({**changes, **RESILIENT})
    streams = demonstrations(strict)
    expected, found = simulate(strict, streams), simulate(resilient, streams)
    for name, reference in expected.items():
        for one, other in zip(found[name], reference, strict=True):
            np.testing.assert_allclose(one.theta, other.theta, rtol=0, atol=1e-12)
            np.testing.assert_allclose(one.omega, other.omega, rtol=0, atol=1e-12)


def test_an_experiment_decides_how_its_learners_mix() -> None:
    strict, resilient = experiment(), experiment({"mixing": {"kind": "resilient", "smallest_weight": 0.25}})
    schedule = strict.edge_schedule
    assert build_learner(strict, "ann").mixer == StrictMixer("ann", schedule)
    assert build_learner(resilient, "ann").mixer == PushSumMixer("ann", schedule, 0.25)
    assert (strict.mixing.declares_members, resilient.mixing.declares_members) == (False, True)


def test_a_strict_network_cannot_go_on_without_a_message() -> None:
    settings = experiment()
    with pytest.raises(ScheduleError, match="iteration 2: parameters of learners"):
        simulate(settings, demonstrations(settings), delivers=lambda n, _sender, _receiver: n < 2)


def test_a_schedule_that_stops_may_stop_with_the_last_iteration() -> None:
    slots = [[["ann", "bob"], ["bob", "ann"]]] * experiment().iterations
    written = {"kind": "slots", "slots": slots, "end": "stop"}
    changes = {"learners": ["ann", "bob"], "schedule": written}
    strict, resilient = experiment(changes), experiment({**changes, **RESILIENT})
    streams = demonstrations(strict)
    expected, found = (simulate(settings, streams)["ann"][-1] for settings in (strict, resilient))
    np.testing.assert_allclose(found.theta, expected.theta, rtol=0, atol=1e-12)


# A stationary problem that shows a bias: learner v minimises |x - b_v|^2 / 2, together they minimise at the mean of b.
TARGETS = np.array([[0.0, 10.0], [4.0, -2.0], [8.0, 0.0], [20.0, 4.0]])
STEPS = PaperSteps(alpha=0.5, beta=0.5, eta1=0.75, eta2=0.75)


def ring() -> EdgeSchedule:
    edges = frozenset(edge for u in range(4) for edge in ((u, (u + 1) % 4), ((u + 1) % 4, u)))
    return EdgeSchedule(("a", "b", "c", "d"), (edges,))


def equal_loss(rng: np.random.Generator) -> Callable[[int, int], bool]:
    return lambda _sender, _receiver: rng.random() >= 0.3


def unequal_loss(rng: np.random.Generator) -> Callable[[int, int], bool]:
    """Of what the last learner sends 60 % are lost, of all else nothing."""
    return lambda sender, _receiver: sender != 3 or rng.random() >= 0.6


LOSSES = {"30 % everywhere": equal_loss, "60 % of one": unequal_loss}
ITERATIONS = 6000


def by_push_sum(arrives: Callable[[int, int], bool]) -> Array:
    """Every learner's final estimate, shape (4, 2)."""
    schedule, size = ring(), TARGETS.shape[1]
    states = [PushSumState.init(Parameters(np.zeros(size), np.zeros(0))) for _ in range(4)]
    for n in range(1, ITERATIONS + 1):
        estimates = [state.estimate().theta for state in states]
        weights = schedule.weights(n)
        for v, state in enumerate(states):
            outgoing_weights = {str(u): float(weights[u, v]) for u in range(4) if u != v and weights[u, v] > 0}
            states[v] = state.send(outgoing_weights, float(weights[v, v]))
        sent = [state.sent for state in states]
        for v in range(4):
            for u in schedule.in_neighbours(v, n):
                if arrives(u, v):
                    states[v] = states[v].receive(str(u), sent[u][str(v)])
            step = -STEPS.at(n)[1] * (estimates[v] - TARGETS[v])
            states[v] = states[v].add_to_mass(Parameters(step, np.zeros(0)))
    return np.stack([state.estimate().theta for state in states])


def by_keeping_the_weight(arrives: Callable[[int, int], bool]) -> Array:
    """The tempting alternative: a silent neighbour's weight is added to one's own."""
    schedule, x = ring(), np.zeros_like(TARGETS)
    for n in range(1, ITERATIONS + 1):
        weights = schedule.weights(n).copy()
        for v in range(4):
            for u in schedule.in_neighbours(v, n):
                if not arrives(u, v):
                    weights[v, v], weights[v, u] = weights[v, v] + weights[v, u], 0.0
        x = weights @ x - STEPS.at(n)[1] * (x - TARGETS)
    return x


@pytest.mark.parametrize("loss", LOSSES)
def test_it_converges_to_the_common_optimum_under_loss(loss: str) -> None:
    found = by_push_sum(LOSSES[loss](np.random.default_rng(1)))
    assert np.abs(found - TARGETS.mean(axis=0)).max() < 0.1


def test_keeping_a_silent_neighbours_weight_is_biased_under_unequal_loss() -> None:
    """The learner that is heard less counts less: the others pull away from the common optimum for good."""
    found = by_keeping_the_weight(unequal_loss(np.random.default_rng(1)))
    assert np.abs(found.mean(axis=0) - TARGETS.mean(axis=0)).max() > 1.0
    assert np.abs(by_keeping_the_weight(lambda *_: True) - TARGETS.mean(axis=0)).max() < 0.1


# The same on a game: four learners who each see one demonstration, over and over, as different as their starts are.
GAME = {
    **FOUR,
    "schedule": {"kind": "static", "graph": "ring"},
    "algorithm": {
        "steps": {"kind": "paper", "alpha": 0.5, "beta": 0.5, "eta1": 0.75, "eta2": 0.75},
        "window": 1,
        "rollout_start": "initial",
        "expectation": "exact",
    },
    "game.starts": [[[0, 0], [0, 2]], [[0, 1], [1, 0]], [[1, 2], [0, 1]]],
    "iterations": 400,
    "demonstrations.per_learner": 400,
}


@cache
def streams_of_one_each() -> dict[str, Any]:
    settings = experiment(GAME)
    drawn = demonstrations(settings)
    return {name: [drawn[name][k]] * settings.iterations for k, name in enumerate(settings.learners)}


def common_estimate(history: History) -> Vector:
    """theta and omega at the end, averaged over the learners."""
    return np.asarray(np.mean([np.concatenate(parameters[-1]) for parameters in history.values()], axis=0))


@cache
def estimate_without_loss() -> Vector:
    """By strict mixing, which loses nothing."""
    return common_estimate(simulate(experiment(GAME), streams_of_one_each()))


def distance(one: Vector, other: Vector) -> float:
    return float(np.linalg.norm(one - other) / np.linalg.norm(other))


@pytest.mark.parametrize("loss", LOSSES)
def test_learners_of_a_game_end_where_they_end_without_loss(loss: str) -> None:
    streams, arrives = streams_of_one_each(), LOSSES[loss](np.random.default_rng(2))
    index = FOUR["learners"].index
    history = simulate(
        experiment({**GAME, **RESILIENT}),
        streams,
        delivers=lambda _, sender, receiver: arrives(index(sender), index(receiver)),
    )
    assert distance(common_estimate(history), estimate_without_loss()) < 0.03


def test_learners_that_keep_a_silent_neighbours_weight_end_elsewhere(monkeypatch: pytest.MonkeyPatch) -> None:
    streams, arrives = streams_of_one_each(), unequal_loss(np.random.default_rng(2))
    expected = estimate_without_loss()

    def weighted_sum(mixer: StrictMixer, state: StrictState, iteration: int) -> Parameters:
        index = mixer.schedule.learners.index
        weights = mixer.schedule.weights(iteration)[index(mixer.name)]
        neighbours: Mapping[int, Parameters] = {index(name): known for name, known in (state.received or {}).items()}
        heard = {u: known for u, known in neighbours.items() if arrives(u, index(mixer.name))}
        kept = 1.0 - sum(weights[u] for u in heard)
        parts = [(kept, state.parameters), *((weights[u], known) for u, known in heard.items())]
        return Parameters(
            sum(weight * part.theta for weight, part in parts), sum(weight * part.omega for weight, part in parts)
        )

    monkeypatch.setattr(StrictMixer, "_weighted_sum", weighted_sum)
    assert distance(common_estimate(simulate(experiment(GAME), streams)), expected) > 0.2
