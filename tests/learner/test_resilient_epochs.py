"""Who takes part in a resilient exchange: founders, late joiners, those who depart and return, and their epochs."""

import numpy as np
import pytest
from sessions import Streams, push_sum_session, some_sum

from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment
from mabirds_learner.learner_session import LearnerSession
from mabirds_learner.member import Limits
from mabirds_learner.push_sum_member import PushSumMember

NAMES = ("learner_1", "learner_2", "learner_3", "learner_4")


def test_a_founder_takes_part_at_once(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_1")
    assert (session.epoch, session.member.members, session.member.joining, session.finished) == (1, NAMES, False, False)
    assert session.member.metrics() == pytest.approx(
        {
            "weight": 1 / 3,
            "initial_weight": 1.0,
            "weight_sent.learner_2": 1 / 3,
            "weight_sent.learner_4": 1 / 3,
        }
    )
    assert list(session.member.outgoing()) == ["learner_2", "learner_4"]
    assert list(session.kept) == [1]


def test_a_late_joiner_waits_for_a_declaration_and_then_for_a_gift(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_4", late_joiner=True)
    assert (session.epoch, session.member.members, session.member.joining, session.finished) == (0, (), True, False)
    assert session.member.metrics() == {"weight": 0.0, "initial_weight": 0.0}
    assert (session.member.outgoing(), session.missing_neighbours()) == ({}, ["membership"])
    session.member.give_up_waiting()
    assert session.missing_neighbours() == ["membership"], "it cannot go on without"
    session.member.follow(5, NAMES)
    assert (session.epoch, session.member.joining, session.finished) == (5, True, False)
    assert (session.member.outgoing(), session.missing_neighbours()) == ({}, ["learner_1", "learner_2", "learner_3"])
    session.member.give_up_waiting()
    assert session.missing_neighbours() == ["learner_1", "learner_2", "learner_3"]
    session.member.receive_mass("learner_3", 6, 9, some_sum(session))
    assert session.member.joining, "that is of another epoch"
    session.member.receive_mass("learner_3", 5, 7, some_sum(session, 0.05))
    assert (session.member.joining, session.iteration) == (True, 1), "that is too little"
    session.member.receive_mass("learner_1", 5, 6, some_sum(session, 0.3))
    assert (session.member.joining, session.iteration) == (False, 7)
    assert list(session.member.outgoing()) == ["learner_1", "learner_3"]
    assert session.member.metrics()["initial_weight"] == 0.0
    assert session.member._received_at == {"learner_1": 6, "learner_3": 7}
    assert list(session.kept) == [1, 7]
    assert session.missing_neighbours() == ["learner_1", "learner_3"]


def test_a_late_joiner_learns_from_the_demonstrations_from_where_it_begins(ring: Experiment, streams: Streams) -> None:
    session = push_sum_session(ring, "learner_4", late_joiner=True)
    for n in (4, 6, 7, 8):
        session.receive_demonstration(n, streams["learner_4"][n - 1])
    session.member.follow(2, NAMES)
    session.member.receive_mass("learner_3", 2, 7, some_sum(session))
    assert (session.iteration, session.backlog, session.missing_demonstration) == (7, 2, False)


def test_a_late_joiner_joins_at_once_by_what_came_before_its_declaration(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_4", late_joiner=True)
    session.member.receive_mass("learner_3", 3, 4, some_sum(session))
    session.member.receive_mass("learner_3", 3, 5, some_sum(session, 2.0))
    session.member.follow(3, NAMES)
    assert (session.member.joining, session.iteration) == (False, 5)
    assert session.member.metrics()["weight_received.learner_3"] == 2.0


def test_sums_of_an_epoch_wait_for_it_and_those_of_earlier_ones_are_dropped(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_1")
    for epoch in (1, 2, 3):
        session.member.receive_mass("learner_2", epoch, 1, some_sum(session))
    session.member.follow(2, NAMES)
    assert sorted(session.member._inboxes) == [2, 3]
    assert session.missing_neighbours() == ["learner_4"]
    session.member.receive_mass("learner_4", 2, 1, some_sum(session))
    assert session.missing_neighbours() == []
    with pytest.raises(RefusedMessageError, match="epoch 1, expected 2 to 18"):
        session.member.receive_mass("learner_2", 1, 2, some_sum(session))


@pytest.mark.parametrize("epoch", [2, 3, 17])
def test_a_new_epoch_begins_with_the_estimate_and_weight_one(ring: Experiment, streams: Streams, epoch: int) -> None:
    session = push_sum_session(ring, "learner_2")
    session.receive_demonstration(1, streams["learner_2"][0])
    session.member.receive_mass("learner_1", 1, 1, some_sum(session))
    session.member.give_up_waiting()
    session.step()
    session.member.follow(epoch, ["learner_3", "learner_2", "learner_1"])
    assert (session.epoch, session.member.members) == (epoch, NAMES[:3])
    assert (session.member.joining, session.iteration, session.member._received_at) == (False, 2, {})
    assert session.member.metrics() == pytest.approx(
        {"weight": 1 / 3, "initial_weight": 1.0, "weight_sent.learner_1": 1 / 3, "weight_sent.learner_3": 1 / 3}
    )


def test_what_was_prepared_in_an_earlier_epoch_is_made_anew(ring: Experiment, streams: Streams) -> None:
    prepared, other = push_sum_session(ring, "learner_2"), push_sum_session(ring, "learner_2")
    for session in (prepared, other):
        session.receive_demonstration(1, streams["learner_2"][0])
    prepared.prepare()
    assert not prepared.can_prepare
    for session in (prepared, other):
        session.member.follow(2, NAMES[:3])
        session.member.give_up_waiting()
    assert prepared.can_prepare
    assert prepared.step() == other.step()
    assert prepared.parameters.theta.tobytes() == other.parameters.theta.tobytes()


def test_who_departed_comes_back_as_a_late_joiner(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_4")
    session.member.follow(2, NAMES[:3])
    assert (session.finished, session.member.is_member, session.member.joining) == (True, False, False)
    assert (session.missing_neighbours(), session.member.outgoing(), session.ready) == ([], {}, False)
    session.member.follow(3, NAMES)
    assert (session.finished, session.member.is_member, session.member.joining) == (False, True, True)
    assert session.member.metrics() == {"weight": 0.0, "initial_weight": 0.0}
    session.member.receive_mass("learner_1", 3, 2, some_sum(session))
    assert (session.member.joining, session.iteration) == (False, 2)


def test_a_neighbour_that_never_got_a_share_hears_of_the_iteration_by_a_sum_of_nothing(ring: Experiment) -> None:
    member = push_sum_session(ring, "learner_1").member
    given = member.push_sum.sent["learner_4"]
    member.state = member.state._replace(mixing=member.push_sum._replace(sent={"learner_4": given}))
    outgoing = member.outgoing()
    assert list(outgoing) == ["learner_2", "learner_4"]
    assert outgoing["learner_4"] is given
    np.testing.assert_array_equal(np.stack(outgoing["learner_2"]), np.zeros((2, member.push_sum.mass.size)))


def test_sums_enter_in_the_order_of_names_whoever_was_first(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_1")
    for name in ("learner_4", "learner_2"):
        session.member.receive_mass(name, 1, 1, some_sum(session))
    assert list(session.member.incoming()) == ["learner_2", "learner_4"]


def test_who_departed_waits_for_nobody_else_than_a_declaration(ring: Experiment) -> None:
    member = push_sum_session(ring, "learner_4").member
    member.follow(2, NAMES[:3])
    member.give_up_waiting()
    assert member.missing() == ["membership"]


def test_a_late_joiner_that_the_first_declaration_leaves_out_has_departed(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_4", late_joiner=True)
    assert not session.member.departed
    session.member.follow(1, NAMES[:3])
    assert (session.epoch, session.member.departed, session.finished) == (1, True, True)


def test_after_the_last_update_nothing_is_given_or_waited_for(ring: Experiment, streams: Streams) -> None:
    session = LearnerSession(PushSumMember(build_learner(ring, "learner_1"), Limits(1, 256, 64, closing_rounds=1)))
    session.receive_demonstration(1, streams["learner_1"][0])
    session.member.give_up_waiting()
    assert session.step().keys() >= {"gradient_theta_norm", "gradient_omega_norm", "weight", "initial_weight"}
    assert (session.finished, session.waiting_for()) == (False, ["learner_2", "learner_4"])
    assert list(session.member.outgoing()) == ["learner_2", "learner_4"]
    session.member.give_up_waiting()
    assert not any(name.startswith("gradient") for name in session.step())
    assert (session.finished, session.waiting_for(), session.member.outgoing()) == (True, [], {})


@pytest.mark.parametrize("late_joiner", [False, True])
def test_a_restart_goes_on_in_the_same_epoch(ring: Experiment, late_joiner: bool) -> None:
    session = push_sum_session(ring, "learner_2", late_joiner=late_joiner)
    session.member.follow(4, NAMES[:3])
    if late_joiner:
        session.member.receive_mass("learner_1", 4, 6, some_sum(session))
    again = push_sum_session(ring, "learner_2", late_joiner=late_joiner)
    again.restore({session.iteration: session.arrays()})
    for one in (session, again):
        assert (one.epoch, one.member.members, one.member.joining) == (4, NAMES[:3], False)
        assert (one.member.metrics()["initial_weight"], one.missing_neighbours()) == (
            0.0 if late_joiner else 1.0,
            ["learner_1", "learner_3"],
        )
        assert list(one.member.outgoing()) == ["learner_1", "learner_3"]
    assert again.member.metrics() == session.member.metrics()
    assert again.member._received_at == ({"learner_1": 6} if late_joiner else {})


def test_who_departed_is_neither_waited_for_nor_sent_to_after_a_restart(ring: Experiment) -> None:
    session, again = (push_sum_session(ring, "learner_1") for _ in range(2))
    session.member.follow(4, NAMES[:3])
    again.restore({1: session.arrays()})
    for one in (session, again):
        assert (one.missing_neighbours(), list(one.member.outgoing())) == (["learner_2"], ["learner_2"])
    assert again.learner.mixer == session.learner.mixer


def test_a_late_joiner_that_still_waits_goes_on_waiting_after_a_restart(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_2", late_joiner=True)
    again = push_sum_session(ring, "learner_2")
    again.restore({1: session.arrays()})
    assert (again.epoch, again.member.members, again.member.joining, again.member.is_member) == (0, (), True, False)
    assert (again.missing_neighbours(), again.member.metrics()["initial_weight"]) == (["membership"], 0.0)
