"""Strict mode without ROS: iteration numbers decide, never arrival order."""

import random
from collections.abc import Callable, Iterator
from contextlib import nullcontext, suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sessions import demonstrations

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.consensus.assumptions import connectivity_window
from mabirds_core.consensus.schedule import EdgeSchedule, both_ways
from mabirds_core.consensus.weights import Edge
from mabirds_core.errors import RefusedMessageError, ScheduleError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.interface import Trajectories
from mabirds_learner.learner_session import DEMONSTRATION, LearnerSession
from mabirds_learner.member import Limits
from mabirds_learner.strict_member import StrictMember, default_history, longest_lead

SLOTS = {"kind": "slots", "slots": [[["learner_1", "learner_2"], ["learner_2", "learner_1"]], []]}


def session(experiment: Experiment, name: str = "learner_1", history: int = 64) -> LearnerSession[StrictMember]:
    limits = Limits(experiment.iterations, 10, history)
    return LearnerSession(StrictMember(build_learner(experiment, name), limits))


def messages(experiment: Experiment) -> Iterator[tuple[str, int, object]]:
    """Everything that learner_1 will ever receive: (kind, iteration, content)."""
    streams = demonstrations(experiment)
    history = simulate(experiment, streams)
    for iteration in range(1, experiment.iterations + 1):
        yield DEMONSTRATION, iteration, streams["learner_1"][iteration - 1]
        yield "learner_2", iteration, history["learner_2"][iteration - 1]


def deliver(target: LearnerSession[StrictMember], kind: str, iteration: int, content: object) -> None:
    if kind == DEMONSTRATION:
        assert isinstance(content, Trajectories)
        target.receive_demonstration(iteration, content)
    else:
        assert isinstance(content, Parameters)
        target.member.receive_parameters("learner_2", iteration, content)


@pytest.mark.parametrize("ahead", [False, True])
@pytest.mark.parametrize("seed", range(5))
def test_any_order_of_arrival_gives_the_same_bits(experiment: Experiment, seed: int, ahead: bool) -> None:
    expected = simulate(experiment, demonstrations(experiment))["learner_1"]
    target, everything = session(experiment), list(messages(experiment))
    random.Random(seed).shuffle(everything)
    found = [target.state.parameters]
    for message in everything:
        deliver(target, *message)
        while target.ready or (ahead and target.can_prepare):
            if target.ready:
                target.step()
                found.append(target.state.parameters)
            else:
                target.prepare()
    assert target.finished
    for one, other in zip(found, expected, strict=True):
        assert one.theta.tobytes() == other.theta.tobytes()
        assert one.omega.tobytes() == other.omega.tobytes()


def test_it_waits_for_demonstration_and_neighbour_by_name(experiment: Experiment) -> None:
    target, (first, second, *_) = session(experiment), list(messages(experiment))
    assert target.waiting_for() == ["demonstration", "learner_2"], "words that a status shows"
    deliver(target, *first)
    assert target.waiting_for() == ["learner_2"]
    assert not target.ready
    deliver(target, *second)
    assert target.waiting_for() == []
    assert target.ready


def test_what_needs_nobody_else_is_made_while_a_neighbour_is_waited_for(experiment: Experiment) -> None:
    target, (first, second, *_) = session(experiment), list(messages(experiment))
    assert not target.can_prepare, "there is no demonstration"
    deliver(target, *first)
    assert target.can_prepare
    target.prepare()
    assert not target.can_prepare, "once is enough"
    assert (target.iteration, target.waiting_for(), target.ready) == (1, ["learner_2"], False)
    deliver(target, *second)
    shown = target.step()
    other = session(experiment)
    deliver(other, *first)
    deliver(other, *second)
    assert other.step() == shown
    assert not target.can_prepare, "there is no other demonstration"


def test_a_closed_edge_is_neither_waited_for_nor_mixed(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_experiment(schedule=SLOTS))
    target = session(experiment)
    for message in messages(experiment):
        deliver(target, *message)
    mixed = []
    while target.ready:
        target.step()
        mixed.append(target.mixed_from)
    assert mixed == [["learner_2"], []] * (experiment.iterations // 2)


def test_parameters_for_an_edge_that_is_closed_are_not_kept(make_experiment: Callable[..., Path]) -> None:
    closed_first = {"kind": "slots", "slots": list(reversed(SLOTS["slots"]))}
    target = session(load_experiment(make_experiment(schedule=closed_first)))
    for known in (target.parameters, Parameters(target.parameters.theta + 1, target.parameters.omega)):
        target.member.receive_parameters("learner_2", 1, known)
        target.member.receive_parameters("learner_2", 3, known)
    assert (target.lag, target.missing_neighbours()) == (0, [])
    target.member.receive_parameters("learner_2", 2, target.parameters)
    assert target.lag == 1


def test_parameters_of_no_iteration_are_refused_whatever_edge_would_be_open(
    make_experiment: Callable[..., Path],
) -> None:
    target = session(load_experiment(make_experiment(schedule=SLOTS)))
    with pytest.raises(RefusedMessageError, match="iteration 0, expected 1 or later"):
        target.member.receive_parameters("learner_2", 0, target.parameters)


def test_parameters_that_arrive_for_a_closed_edge_change_nothing(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_experiment(schedule=SLOTS))
    targets = session(experiment), session(experiment)
    for index, target in enumerate(targets):
        for kind, iteration, content in list(messages(experiment))[:4]:
            closed = isinstance(content, Parameters) and iteration == 2
            spoiled = Parameters(content.theta + index * 1e6, content.omega) if closed else content
            deliver(target, kind, iteration, spoiled)
        while target.ready:
            target.step()
    assert targets[0].iteration == 3
    assert targets[0].state.parameters.theta.tobytes() == targets[1].state.parameters.theta.tobytes()


@pytest.mark.parametrize(
    ("iteration", "reason"), [(0, "old_iteration"), (1, "old_iteration"), (2, "duplicate"), (12, "future_iteration")]
)
def test_what_does_not_fit_is_refused_by_name(experiment: Experiment, iteration: int, reason: str) -> None:
    target, streams = session(experiment), demonstrations(experiment)["learner_1"]
    for message in list(messages(experiment))[:2]:
        deliver(target, *message)
    target.step()
    target.receive_demonstration(2, streams[1])
    with pytest.raises(RefusedMessageError) as refused:
        target.receive_demonstration(iteration, streams[0 if iteration == 1 else 1])
    assert refused.value.reason == reason
    assert target.backlog == 1


@pytest.mark.parametrize(
    ("iteration", "reason"),
    [
        (0, "old_iteration"),
        (1, "old_iteration"),
        (2, None),
        (3, "duplicate"),
        (6, None),
        (7, "future_iteration"),
        (2**64 - 1, "future_iteration"),
    ],
)
def test_parameters_that_do_not_fit_are_refused_by_name(
    experiment: Experiment, iteration: int, reason: str | None
) -> None:
    target, everything = session(experiment, history=5), list(messages(experiment))
    for message in everything[:2]:
        deliver(target, *message)
    target.step()
    known = target.parameters
    target.member.receive_parameters("learner_2", 3, known)
    with pytest.raises(RefusedMessageError) if reason else nullcontext() as refused:
        target.member.receive_parameters("learner_2", iteration, known)
    assert refused is None or refused.value.reason == reason
    assert target.lag == (4 if iteration == 6 else 1)


def test_the_first_parameters_of_an_iteration_stay(experiment: Experiment) -> None:
    target, ((_, _, demonstration), (_, _, sent), *_) = session(experiment), list(messages(experiment))
    assert isinstance(sent, Parameters)
    deliver(target, DEMONSTRATION, 1, demonstration)
    deliver(target, "learner_2", 1, sent)
    with pytest.raises(RefusedMessageError) as refused:
        target.member.receive_parameters("learner_2", 1, Parameters(sent.theta + 1, sent.omega))
    assert refused.value.reason == "conflict"
    target.step()
    expected = simulate(experiment, demonstrations(experiment))["learner_1"][1]
    assert target.parameters.theta.tobytes() == expected.theta.tobytes()


def is_kept(target: LearnerSession[StrictMember], iteration: int, trajectory: Trajectories) -> bool:
    with suppress(RefusedMessageError):
        target.receive_demonstration(iteration, trajectory)
        return True
    return False


def test_no_demonstration_past_the_last_one_or_the_history_is_kept(experiment: Experiment) -> None:
    """Of six iterations with room for four: at first 1 to 4, and near the end no more than there are."""
    trajectory = demonstrations(experiment)["learner_1"][0]
    accepted = []
    for _ in range(experiment.iterations + 2):
        at = len(accepted) + 1
        limits = Limits(experiment.iterations, 4, 64, closing_rounds=2)
        target = LearnerSession(StrictMember(build_learner(experiment, "learner_1"), limits))
        target.member.state = target.state._replace(iteration=at)
        assert target.missing_demonstration == (at <= experiment.iterations)
        accepted.append([n for n in range(at, 12) if is_kept(target, n, trajectory)])
        assert target.backlog == len(accepted[-1])
    assert accepted == [[1, 2, 3, 4], [2, 3, 4, 5], [3, 4, 5, 6], [4, 5, 6], [5, 6], [6], [], []]


def test_a_history_shorter_than_a_neighbours_lead_is_refused(experiment: Experiment) -> None:
    with pytest.raises(ScheduleError, match="parameter_history 1: .* set at least 2"):
        session(experiment, history=1)
    assert session(experiment, history=2).missing_neighbours() == ["learner_2"]


def test_as_many_iterations_are_kept_as_the_schedule_needs_and_256_at_least() -> None:
    pair, nothing = both_ways([(0, 1)]), frozenset[Edge]()
    rare = EdgeSchedule(("a", "b"), (pair, *[nothing] * 255))
    rarer = EdgeSchedule(("a", "b"), (pair, *[nothing] * 299))
    three = EdgeSchedule(("a", "b", "c"), (both_ways([(0, 1)]), both_ways([(1, 2)]), nothing))
    assert [longest_lead(schedule) for schedule in (three, rare, rarer)] == [6, 256, 300]
    assert [default_history(schedule) for schedule in (three, rare, rarer)] == [256, 257, 301]


def test_own_parameters_are_kept_for_neighbours_that_ask_again(experiment: Experiment) -> None:
    target = session(experiment, history=3)
    states = {1: target.state.parameters}
    assert list(target.kept) == [1]
    for message in messages(experiment):
        deliver(target, *message)
        while target.ready:
            target.step()
            states[target.iteration] = target.state.parameters
    newest = experiment.iterations + 1
    for iteration in (newest, newest - 1, newest - 2):
        kept = target.kept.get(iteration)
        assert kept is not None
        assert np.array_equal(kept.theta, states[iteration].theta)
    assert target.kept.get(newest - 3) is None


@given(
    n_learners=st.integers(2, 5),
    slots=st.lists(st.sets(st.tuples(st.integers(0, 4), st.integers(0, 4))), min_size=1, max_size=4),
    stalled=st.integers(0, 4),
    start=st.integers(1, 4),
)
def test_no_learner_runs_further_ahead_than_the_bound(
    n_learners: int, slots: list[set[tuple[int, int]]], stalled: int, start: int
) -> None:
    """One learner stalls at an iteration; the others go on for as long as strict mode lets them."""
    edges = [{(u, v) for u, v in slot if u != v and max(u, v) < n_learners} for slot in slots]
    for v in range(n_learners):  # the ring, spread over the slots, so that their union connects all
        edges[v % len(edges)].add((v, (v + 1) % n_learners))
    schedule = EdgeSchedule(tuple(f"learner_{v}" for v in range(n_learners)), tuple(map(frozenset, edges)))
    bound = connectivity_window(schedule) * (n_learners - 1)
    at = dict.fromkeys(range(n_learners), start)
    movable = True
    while movable and max(at.values()) <= start + bound:
        movable = False
        for v in set(at) - {stalled % n_learners}:
            if all(at[u] >= at[v] for u in schedule.in_neighbours(v, at[v])):
                at[v] += 1
                movable = True
    assert max(at.values()) <= start + bound


def test_closing_rounds_wait_for_neighbours_and_for_no_demonstration(experiment: Experiment) -> None:
    learner, streams = build_learner(experiment, "learner_1"), demonstrations(experiment)
    session = LearnerSession(StrictMember(learner, Limits(1, 256, 64, closing_rounds=1)))
    session.receive_demonstration(1, streams["learner_1"][0])
    session.member.receive_parameters("learner_2", 1, session.parameters)
    assert set(session.step()) == {"gradient_theta_norm", "gradient_omega_norm", "held_out_log_likelihood"}
    assert (session.finished, session.missing_demonstration, session.waiting_for()) == (False, False, ["learner_2"])
    other = Parameters(session.parameters.theta + 2, session.parameters.omega + 4)
    expected = session.parameters.theta + 1, session.parameters.omega + 2
    session.member.receive_parameters("learner_2", 2, other)
    assert session.ready
    assert session.step() == {}
    np.testing.assert_allclose(session.parameters.theta, expected[0], atol=1e-12)
    np.testing.assert_allclose(session.parameters.omega, expected[1], atol=1e-12)
    assert (session.finished, session.waiting_for(), session.ready) == (True, [], False)


def test_the_lag_is_how_far_a_neighbour_is_ahead(experiment: Experiment) -> None:
    target = session(experiment)
    assert target.lag == 0
    target.member.receive_parameters("learner_2", 4, target.state.parameters)
    target.member.receive_parameters("learner_2", 1, target.state.parameters)
    assert target.lag == 3


def test_what_served_an_update_is_dropped(experiment: Experiment) -> None:
    target, everything = session(experiment), list(messages(experiment))
    for message in everything[:3]:
        deliver(target, *message)
    assert (target.backlog, target.lag) == (2, 0)
    target.step()
    assert (target.backlog, target.lag, target.waiting_for()) == (1, 0, ["learner_2"])


def test_a_strict_member_follows_no_membership_and_has_nothing_to_keep(experiment: Experiment) -> None:
    member = session(experiment).member
    assert (member.epoch, member.departed, member.metrics(), member.arrays()) == (0, False, {}, {})


def test_a_checkpoint_is_the_state_and_whose_parameters_entered_it(experiment: Experiment) -> None:
    """By the names that earlier versions wrote."""
    target, again = session(experiment), session(experiment)
    for message in list(messages(experiment))[:2]:
        deliver(target, *message)
    target.step()
    arrays = target.arrays()
    assert set(arrays) >= {"theta", "omega", "mixed_from"}
    assert arrays["mixed_from"].tolist() == [1.0]
    again.restore({2: arrays})
    assert (again.iteration, again.mixed_from) == (2, ["learner_2"])
    assert again.member.state.iteration == 2
    assert again.parameters.theta.tobytes() == target.parameters.theta.tobytes()


def test_the_certificate_of_a_plan_is_a_metric_and_a_bad_one_a_warning(
    make_drone_experiment: Callable[..., Path], monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    experiment = load_experiment(make_drone_experiment())
    streams = demonstrations(experiment)
    first = {}
    for nats in (None, 3.0):
        if nats:
            monkeypatch.setattr("mabirds_core.games.drones.judge.RolloutJudge.certificate", lambda *_: 3.0)
        target = session(experiment)
        target.receive_demonstration(1, streams["learner_1"][0])
        target.member.receive_parameters("learner_2", 1, target.parameters)
        first[nats] = target.step()
        assert ("iteration 1: the planner's value is 3 nats from" in caplog.text) == bool(nats)
    assert 0 <= first[None]["certificate"] < 0.1
    assert first[3.0]["certificate"] == 3.0
    assert np.isfinite(first[None]["held_out_log_likelihood"])


def test_the_gap_of_a_search_is_a_metric(make_drone_experiment: Callable[..., Path]) -> None:
    """Of networks that a few gradient steps found it is their critics' own; that of exact values is small."""
    gaps = {}
    for planner in ("guided", "soft_actor_critic"):
        experiment = load_experiment(make_drone_experiment(planner, name=planner))
        target = session(experiment)
        target.receive_demonstration(1, demonstrations(experiment)["learner_1"][0])
        target.member.receive_parameters("learner_2", 1, target.parameters)
        metrics = target.step()
        gaps[planner] = metrics["gap"]
        assert "certificate" not in metrics
    assert abs(gaps["guided"]) < 0.3 < abs(gaps["soft_actor_critic"])
