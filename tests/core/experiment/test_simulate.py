"""The in-process network: streams, synchrony, consensus, and the mean of the learners."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from experiments import demonstrations, experiment
from identity import assert_same_histories

from mabirds_core.algorithm.learner import LearnerState
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.consensus.strict import StrictState
from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import History, Progress, simulate
from mabirds_core.games.interface import Trajectories
from mabirds_core.metrics.metrics import consensus_distance

SLOTS: dict[str, Any] = {
    "kind": "slots",
    "undirected": True,
    "slots": [[["ann", "bob"]], [], [["bob", "cid"]]],
}
EXACT = {"algorithm.expectation": "exact"}


def by_hand(settings: Experiment, streams: dict[str, list[Trajectories]], order: Sequence[str]) -> History:
    """The network once more: in each iteration all update from the parameters at its beginning."""
    learners = {name: build_learner(settings, name) for name in order}
    states = {name: learner.initial_state() for name, learner in learners.items()}
    history: History = {name: [state.parameters] for name, state in states.items()}
    for n in range(1, settings.iterations + 1):
        before = dict(states)
        for name in order:
            edges = settings.edge_schedule.edges(n)
            senders = [u for u, v in edges if v == settings.learners.index(name)]
            neighbours = {settings.learners[u]: before[settings.learners[u]].parameters for u in senders}
            states[name] = learners[name].step(before[name], streams[name][n - 1], neighbours).state
            history[name].append(states[name].parameters)
    return history


@pytest.mark.parametrize(
    "schedule", [{"kind": "static"}, {"kind": "alternating"}, SLOTS], ids=["static", "ring", "slots"]
)
def test_learners_update_together_whatever_their_order(schedule: dict[str, Any]) -> None:
    settings = experiment({"schedule": schedule, "algorithm.window": 2})
    streams = demonstrations(settings)
    expected = by_hand(settings, streams, order=("cid", "ann", "bob"))
    assert_same_histories(simulate(settings, streams), expected)


def test_a_history_holds_every_iteration_of_every_learner_from_zero_on() -> None:
    settings = experiment()
    history = simulate(settings, demonstrations(settings))
    assert list(history) == ["ann", "bob", "cid"]
    for parameters in history.values():
        assert len(parameters) == settings.iterations + 1
        assert not parameters[0].theta.any()
        assert all(np.isfinite(one.theta).all() and np.isfinite(one.omega).all() for one in parameters)
        assert (parameters[1].theta != parameters[-1].theta).any()


def test_iterations_are_reported_in_order() -> None:
    settings, seen = experiment(), list[Progress]()
    simulate(settings, demonstrations(settings), seen.append)
    assert [one.work.gradient_steps for one in seen] == [n for n in range(1, 13) for _ in settings.learners]
    assert [one.name for one in seen[:3]] == list(settings.learners)
    assert all(one.seconds > 0 for one in seen)


def test_the_same_seed_gives_the_same_bits_and_another_seed_others() -> None:
    streams = demonstrations(experiment())
    first, again = (simulate(experiment(), streams) for _ in range(2))
    assert_same_histories(first, again)
    other = simulate(experiment({"seed": 4}), streams)
    assert (other["ann"][-1].theta != first["ann"][-1].theta).any()


def test_a_stream_that_is_too_short_is_refused_by_name_and_numbers() -> None:
    settings = experiment()
    streams = demonstrations(settings)
    streams["bob"].pop()
    with pytest.raises(ExperimentError, match="^bob has 11 demonstrations, expected 12;"):
        simulate(settings, streams)


def test_a_missing_stream_is_refused_by_name() -> None:
    settings = experiment()
    streams = demonstrations(settings)
    del streams["bob"]
    with pytest.raises(ExperimentError, match="bob"):
        simulate(settings, streams)


def test_demonstrations_beyond_the_iterations_change_nothing() -> None:
    settings = experiment({"iterations": 5})
    streams = demonstrations(experiment())
    cut = {name: stream[:5] for name, stream in streams.items()}
    assert_same_histories(simulate(settings, streams), simulate(settings, cut))


def test_a_demonstration_reaches_a_neighbour_one_open_edge_later_and_not_before() -> None:
    """Edges ann-bob at n = 1, 4, ..; bob-cid at 3, 6, ..: what ann sees at 1 bob has after 4, cid after 6."""
    settings = experiment({"schedule": SLOTS, **EXACT})
    streams = demonstrations(settings)
    altered = {**streams, "ann": [streams["bob"][0], *streams["ann"][1:]]}
    assert (streams["ann"][0].actions != altered["ann"][0].actions).any()
    one, other = simulate(settings, streams), simulate(settings, altered)
    first_difference = {
        name: next(n for n in range(13) if (one[name][n].theta != other[name][n].theta).any()) for name in one
    }
    assert first_difference == {"ann": 1, "bob": 4, "cid": 6}


def test_a_single_learner_needs_no_neighbours() -> None:
    settings = experiment({"learners": ["ann"]})
    history = simulate(settings, demonstrations(settings))
    assert_same_histories(history, by_hand(settings, demonstrations(settings), order=("ann",)))


def final_consensus(schedule: dict[str, Any]) -> tuple[float, float]:
    settings = experiment({"schedule": schedule, **EXACT})
    last = [parameters[-1] for parameters in simulate(settings, demonstrations(settings)).values()]
    return consensus_distance([one.theta for one in last]), consensus_distance([one.omega for one in last])


def test_learners_that_mix_at_every_iteration_are_closer_than_learners_that_mix_rarely() -> None:
    together = [["ann", "bob"], ["bob", "cid"]]
    rarely = {"kind": "slots", "undirected": True, "slots": [*[[]] * 5, together, *[[]] * 6]}
    often = {"kind": "static"}
    for close, far in zip(final_consensus(often), final_consensus(rarely), strict=True):
        assert 0 < close < far


def test_complete_mixing_leaves_only_the_last_step_between_learners() -> None:
    """With W = 1/N throughout learners differ by the step times the difference of their gradients."""
    settings = experiment({**EXACT, "learners": ["ann", "bob"]})
    streams = demonstrations(settings)
    history = simulate(settings, streams)
    gradients = gradients_at(settings, history, streams, 12)
    alpha, beta = settings.algorithm.steps.at(12)
    ann, bob = (history[name][12] for name in ("ann", "bob"))
    by_theta, by_omega = (one - other for one, other in zip(*gradients, strict=True))
    np.testing.assert_allclose(ann.theta - bob.theta, -beta * by_theta, rtol=0, atol=1e-12)
    np.testing.assert_allclose(ann.omega - bob.omega, -alpha * by_omega, rtol=0, atol=1e-12)


def gradients_at(
    settings: Experiment, history: History, streams: dict[str, list[Trajectories]], n: int
) -> list[Parameters]:
    """Every learner's gradient at iteration n, for a window of 1."""
    gradients = []
    for v, name in enumerate(settings.learners):
        senders = settings.edge_schedule.in_neighbours(v, n)
        neighbours = {settings.learners[u]: history[settings.learners[u]][n - 1] for u in senders}
        learner = build_learner(settings, name)
        state = LearnerState(n, StrictState(history[name][n - 1]), learner.memory, {})
        result = learner.step(state, streams[name][n - 1], neighbours)
        gradients.append(result.gradient)
    return gradients


def mean(vectors: Sequence[Vector]) -> Vector:
    return np.mean(vectors, axis=0)


@pytest.mark.parametrize("schedule", [{"kind": "alternating"}, SLOTS], ids=["ring", "slots"])
def test_the_mean_over_learners_moves_by_the_mean_gradient_alone(schedule: dict[str, Any]) -> None:
    settings = experiment({"schedule": schedule})
    streams = demonstrations(settings)
    history = simulate(settings, streams)
    for n in range(1, settings.iterations + 1):
        alpha, beta = 2.0 / n**0.51, 1.0 / n**0.51
        gradients = gradients_at(settings, history, streams, n)
        before, after = ([history[name][k] for name in settings.learners] for k in (n - 1, n))
        expected_theta = mean([p.theta for p in before]) - beta * mean([g.theta for g in gradients])
        expected_omega = mean([p.omega for p in before]) - alpha * mean([g.omega for g in gradients])
        np.testing.assert_allclose(mean([p.theta for p in after]), expected_theta, rtol=0, atol=1e-12)
        np.testing.assert_allclose(mean([p.omega for p in after]), expected_omega, rtol=0, atol=1e-12)


def test_learning_makes_the_demonstrations_likelier() -> None:
    """Of all streams, not only of the learner's own."""
    settings = experiment({**EXACT, "algorithm.steps": {"alpha": 0.5, "beta": 0.5}})
    streams = demonstrations(settings)
    history = simulate(settings, streams)
    learner = build_learner(settings, "ann")
    uniform, learned = (learner.estimator.planner.plan(*history["ann"][n]) for n in (0, settings.iterations))
    every = [demonstration for stream in streams.values() for demonstration in stream]

    def log_likelihood(policy: Any) -> float:
        return sum(
            float(policy.log_probabilities(t, one.states[:, t])[0, one.actions[0, t]])
            for one in every
            for t in range(one.states.shape[1])
        )

    assert log_likelihood(learned) > log_likelihood(uniform) + 10


def test_closing_rounds_average_and_take_no_step() -> None:
    plain, closing = experiment(), experiment({"closing_rounds": 2})
    streams, seen = demonstrations(plain), list[Progress]()
    before, after = simulate(plain, streams), simulate(closing, streams, seen.append)
    assert len(seen) == plain.iterations * len(plain.learners)
    assert_same_histories({name: parameters[:-2] for name, parameters in after.items()}, before)
    for part in ("theta", "omega"):
        own = np.array([getattr(before[name][-1], part) for name in plain.learners])
        closed = np.array([getattr(after[name][-1], part) for name in plain.learners])
        np.testing.assert_allclose(closed, np.tile(own.mean(axis=0), (3, 1)), atol=1e-12)
        assert np.abs(own - own.mean(axis=0)).max() > 0.01


def test_two_learners_end_with_the_same_bits_after_one_closing_round() -> None:
    settings = experiment({"learners": ["ann", "bob"], "closing_rounds": 1})
    ann, bob = (parameters[-1] for parameters in simulate(settings, demonstrations(settings)).values())
    assert ann.theta.tobytes() == bob.theta.tobytes()
    assert ann.omega.tobytes() == bob.omega.tobytes()
