"""Who takes part in a resilient exchange: founders, newcomers, those who depart and return, and their epochs."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mabirds_core.assembly import build_game, build_resilient_learner
from mabirds_core.experiment import Experiment, load_experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.push_sum import RunningSum
from mabirds_learner.resilient_session import ResilientSession
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.conversion import RefusedMessageError

Streams = dict[str, list[Trajectories]]
NAMES = ("learner_1", "learner_2", "learner_3", "learner_4")


@pytest.fixture
def experiment(make_experiment: Callable[..., Path]) -> Experiment:
    """Four learners on a ring."""
    schedule = {"kind": "static", "graph": "ring"}
    change = {"mixing": {"kind": "resilient"}}
    return load_experiment(make_experiment(learners=4, iterations=20, schedule=schedule, change=change))


@pytest.fixture
def streams(experiment: Experiment) -> Streams:
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        return {name: list(bag.trajectories(name)) for name in experiment.learners}


def new_session(experiment: Experiment, name: str, *, newcomer: bool = False) -> ResilientSession:
    learner = build_resilient_learner(experiment, name)
    return ResilientSession(learner, experiment.iterations, 256, 64, newcomer=newcomer)


def some_sum(session: ResilientSession, value: float = 1.0) -> RunningSum:
    """Of weight ``value``, and theta and omega of sevens."""
    own = session.state.ledger.own
    return RunningSum.zero(own.size).plus(np.append(np.full(own.size - 1, 7 * value), value))


def test_a_founder_takes_part_at_once(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_1")
    assert (session.epoch, session.members, session.joining, session.finished) == (1, NAMES, False, False)
    assert session.weights() == pytest.approx(
        {
            "weight": 1 / 3,
            "weight_brought": 1.0,
            "weight_given.learner_2": 1 / 3,
            "weight_given.learner_4": 1 / 3,
        }
    )
    assert list(session.given()) == ["learner_2", "learner_4"]
    assert list(session.kept) == [1]


def test_a_newcomer_waits_for_a_declaration_and_then_for_a_gift(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_4", newcomer=True)
    assert (session.epoch, session.members, session.joining, session.finished) == (0, (), True, False)
    assert session.weights() == {"weight": 0.0, "weight_brought": 0.0}
    assert (session.given(), session.missing_neighbours()) == ({}, ["membership"])
    session.stop_waiting()
    assert session.missing_neighbours() == ["membership"], "it cannot go on without"
    session.follow(5, NAMES)
    assert (session.epoch, session.joining, session.finished) == (5, True, False)
    assert (session.given(), session.missing_neighbours()) == ({}, ["learner_1", "learner_2", "learner_3"])
    session.stop_waiting()
    assert session.missing_neighbours() == ["learner_1", "learner_2", "learner_3"]
    session.receive_sum("learner_3", 6, 9, some_sum(session))
    assert session.joining, "that is of another epoch"
    session.receive_sum("learner_3", 5, 7, some_sum(session, 0.05))
    assert (session.joining, session.iteration) == (True, 1), "that is too little"
    session.receive_sum("learner_1", 5, 6, some_sum(session, 0.3))
    assert (session.joining, session.iteration) == (False, 7)
    assert list(session.given()) == ["learner_1", "learner_3"]
    assert session.weights()["weight_brought"] == 0.0
    assert session._taken_at == {"learner_1": 6, "learner_3": 7}
    assert list(session.kept) == [1, 7]
    assert session.missing_neighbours() == ["learner_1", "learner_3"]


def test_a_newcomer_learns_from_the_demonstrations_from_where_it_begins(
    experiment: Experiment, streams: Streams
) -> None:
    session = new_session(experiment, "learner_4", newcomer=True)
    for n in (4, 6, 7, 8):
        session.receive_demonstration(n, streams["learner_4"][n - 1])
    session.follow(2, NAMES)
    session.receive_sum("learner_3", 2, 7, some_sum(session))
    assert (session.iteration, session.backlog, session.missing_demonstration) == (7, 2, False)


def test_a_newcomer_joins_at_once_by_what_came_before_its_declaration(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_4", newcomer=True)
    session.receive_sum("learner_3", 3, 4, some_sum(session))
    session.receive_sum("learner_3", 3, 5, some_sum(session, 2.0))
    session.follow(3, NAMES)
    assert (session.joining, session.iteration) == (False, 5)
    assert session.weights()["weight_taken.learner_3"] == 2.0


def test_sums_of_an_epoch_wait_for_it_and_those_of_earlier_ones_are_dropped(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_1")
    for epoch in (1, 2, 3):
        session.receive_sum("learner_2", epoch, 1, some_sum(session))
    session.follow(2, NAMES)
    assert sorted(session._inboxes) == [2, 3]
    assert session.missing_neighbours() == ["learner_4"]
    session.receive_sum("learner_4", 2, 1, some_sum(session))
    assert session.missing_neighbours() == []
    with pytest.raises(RefusedMessageError, match="epoch 1, expected 2 to 18"):
        session.receive_sum("learner_2", 1, 2, some_sum(session))


@pytest.mark.parametrize("epoch", [2, 3, 17])
def test_a_new_epoch_begins_with_the_estimate_and_weight_one(
    experiment: Experiment, streams: Streams, epoch: int
) -> None:
    session = new_session(experiment, "learner_2")
    session.receive_demonstration(1, streams["learner_2"][0])
    session.receive_sum("learner_1", 1, 1, some_sum(session))
    session.stop_waiting()
    session.step()
    session.follow(epoch, ["learner_3", "learner_2", "learner_1"])
    assert (session.epoch, session.members) == (epoch, NAMES[:3])
    assert (session.joining, session.iteration, session._taken_at) == (False, 2, {})
    assert session.weights() == pytest.approx(
        {"weight": 1 / 3, "weight_brought": 1.0, "weight_given.learner_1": 1 / 3, "weight_given.learner_3": 1 / 3}
    )


def test_who_departed_comes_back_as_a_newcomer(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_4")
    session.follow(2, NAMES[:3])
    assert (session.finished, session.is_member, session.joining) == (True, False, False)
    assert (session.missing_neighbours(), session.given(), session.ready) == ([], {}, False)
    session.follow(3, NAMES)
    assert (session.finished, session.is_member, session.joining) == (False, True, True)
    assert session.weights() == {"weight": 0.0, "weight_brought": 0.0}
    session.receive_sum("learner_1", 3, 2, some_sum(session))
    assert (session.joining, session.iteration) == (False, 2)


def test_after_the_last_update_nothing_is_given_or_waited_for(experiment: Experiment, streams: Streams) -> None:
    session = ResilientSession(build_resilient_learner(experiment, "learner_1"), 1, 256, 64, closing_rounds=1)
    session.receive_demonstration(1, streams["learner_1"][0])
    session.stop_waiting()
    assert "gradient_theta_norm" in session.step()
    assert (session.finished, session.waiting_for()) == (False, ["learner_2", "learner_4"])
    assert list(session.given()) == ["learner_2", "learner_4"]
    session.stop_waiting()
    assert not any(name.startswith("gradient") for name in session.step())
    assert (session.finished, session.waiting_for(), session.given()) == (True, [], {})


@pytest.mark.parametrize("newcomer", [False, True])
def test_a_restart_goes_on_in_the_same_epoch(experiment: Experiment, newcomer: bool) -> None:
    session = new_session(experiment, "learner_2", newcomer=newcomer)
    session.follow(4, NAMES[:3])
    if newcomer:
        session.receive_sum("learner_1", 4, 6, some_sum(session))
    again = new_session(experiment, "learner_2", newcomer=newcomer)
    again.resume({session.iteration: session.arrays()})
    for one in (session, again):
        assert (one.epoch, one.members, one.joining) == (4, NAMES[:3], False)
        assert (one.weights()["weight_brought"], one.missing_neighbours()) == (
            0.0 if newcomer else 1.0,
            ["learner_1", "learner_3"],
        )
        assert list(one.given()) == ["learner_1", "learner_3"]
    assert again.weights() == session.weights()
    assert again._taken_at == ({"learner_1": 6} if newcomer else {})


def test_a_newcomer_that_still_waits_goes_on_waiting_after_a_restart(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_2", newcomer=True)
    again = new_session(experiment, "learner_2")
    again.resume({1: session.arrays()})
    assert (again.epoch, again.members, again.joining, again.is_member) == (0, (), True, False)
    assert (again.missing_neighbours(), again.weights()["weight_brought"]) == (["membership"], 0.0)
