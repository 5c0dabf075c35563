"""Resilient mode without ROS: late neighbours, epochs, late joiners, and going on from checkpoints."""

import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from identity import bits
from sessions import Streams, demonstrations, push_sum_session, some_sum

from mabirds_core.consensus.push_sum import RunningSum
from mabirds_core.errors import ExperimentError, RefusedMessageError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import simulate
from mabirds_learner.learner_session import SHOWN
from mabirds_learner.member import Limits
from mabirds_learner.push_sum_member import PushSumMember

NAMES = ("learner_1", "learner_2", "learner_3", "learner_4")


class LossyNetwork:
    """Sessions that tell each other what they gave, on links that lose at random."""

    def __init__(self, experiment: Experiment, streams: Streams, seed: int, loss: float) -> None:
        self.streams, self.rng, self.loss = streams, random.Random(seed), loss
        self.sessions = {name: push_sum_session(experiment, name) for name in experiment.learners}
        self.lost = 0

    def tell(self, name: str) -> None:
        session = self.sessions[name]
        for receiver, total in session.member.outgoing().items():
            if self.rng.random() < self.loss or receiver not in self.sessions:
                self.lost += 1
                continue
            with suppress(RefusedMessageError):  # told again, or contained in what was taken
                self.sessions[receiver].member.receive_mass(name, session.epoch, session.iteration, total)

    def update(self, name: str) -> None:
        session = self.sessions[name]
        if not session.finished and session.missing_demonstration:
            session.receive_demonstration(session.iteration, self.streams[name][session.iteration - 1])
        if not session.ready:
            session.member.give_up_waiting()
        if session.ready:
            session.step()

    def run(self) -> None:
        """Learners take turns at random until all have learned everything."""
        while active := [name for name, session in self.sessions.items() if not session.finished]:
            name = self.rng.choice(active)
            self.tell(name)
            self.update(name)

    def weight(self) -> float:
        """All weight there is: held, and under way."""
        states = {name: session.member.push_sum for name, session in self.sessions.items()}
        under_way = sum(
            sent.since(states[receiver].received.get(sender, RunningSum.zero(sent.total.size)))[-1]
            for sender, state in states.items()
            for receiver, sent in state.sent.items()
        )
        return float(under_way + sum(state.weight for state in states.values()))


def test_in_step_and_without_loss_it_is_the_reference(ring: Experiment, streams: Streams) -> None:
    network = LossyNetwork(ring, streams, seed=0, loss=0.0)
    expected = simulate(ring, streams)
    for n in range(1, ring.iterations + 1):
        for name in NAMES:
            network.tell(name)
        for name in NAMES:
            network.update(name)
            assert network.sessions[name].parameters.theta.tobytes() == expected[name][n].theta.tobytes()
            assert network.sessions[name].mixed_from == sorted(
                ring.learners[u] for u in ring.edge_schedule.in_neighbours(NAMES.index(name), n)
            )


@pytest.mark.parametrize("seed", range(4))
def test_whatever_is_lost_and_whoever_is_ahead_no_mass_is_lost(ring: Experiment, streams: Streams, seed: int) -> None:
    network = LossyNetwork(ring, streams, seed, loss=0.3)
    network.run()
    assert network.lost > 10
    assert network.weight() == pytest.approx(4, abs=1e-12)


def test_a_sum_ahead_of_its_time_waits(ring: Experiment, streams: Streams) -> None:
    network = LossyNetwork(ring, streams, seed=0, loss=0.0)
    session = network.sessions["learner_1"]
    session.receive_demonstration(1, streams["learner_1"][0])
    size = session.member.push_sum.mass.size
    session.member.receive_mass("learner_2", 1, 2, RunningSum.zero(size).plus(np.ones(size)))
    session.member.give_up_waiting()
    assert session.member.metrics()["weight"] == pytest.approx(1 / 3)
    session.step()
    assert session.mixed_from == []
    session.member.give_up_waiting()
    session.receive_demonstration(2, streams["learner_1"][1])
    session.step()
    assert session.mixed_from == ["learner_2"]
    assert session.member.metrics()["weight_received.learner_2"] == 1.0


def test_only_a_neighbour_that_is_there_is_waited_for(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_1")
    assert session.waiting_for() == ["demonstration", "learner_2", "learner_4"]
    session.member.set_alive("learner_4", alive=False)
    assert session.missing_neighbours() == ["learner_2"]
    session.member.set_alive("learner_4", alive=True)
    assert session.missing_neighbours() == ["learner_2", "learner_4"]
    session.member.give_up_waiting()
    assert session.missing_neighbours() == []


def test_a_learner_waits_for_whom_it_hears_and_tells_who_hears_it(make_experiment: Callable[..., Path]) -> None:
    change = {"mixing": {"kind": "resilient"}}
    settings = load_experiment(make_experiment(learners=4, schedule={"kind": "directed_ring"}, change=change))
    session = push_sum_session(settings, "learner_1")
    assert (session.missing_neighbours(), list(session.member.outgoing())) == (["learner_4"], ["learner_2"])


@pytest.mark.parametrize(
    ("epoch", "iteration", "reason"),
    [
        (0, 1, "old_epoch"),
        (1, 3, "duplicate"),
        (1, 2, "old_iteration"),
        (1, 0, "old_iteration"),
        (1, 21, "future_iteration"),
        (1, 2**64 - 1, "future_iteration"),
        (18, 1, "future_epoch"),
        (2**32 - 1, 1, "future_epoch"),
    ],
)
def test_what_is_known_or_out_of_reach_is_not_taken(ring: Experiment, epoch: int, iteration: int, reason: str) -> None:
    session = push_sum_session(ring, "learner_1")
    size = session.member.push_sum.mass.size
    session.member.receive_mass("learner_2", 1, 3, RunningSum.zero(size))
    session.member._received_at["learner_2"] = 2
    with pytest.raises(RefusedMessageError) as error:
        session.member.receive_mass("learner_2", epoch, iteration, RunningSum.zero(size))
    assert error.value.reason == reason


@pytest.mark.parametrize(("epoch", "iteration"), [(1, 1), (1, 4), (1, 20), (2, 1), (2, 3), (17, 20)])
def test_what_is_new_and_within_reach_is_kept(ring: Experiment, epoch: int, iteration: int) -> None:
    """Also at the very ends, and of another epoch whatever is known of this one."""
    session = push_sum_session(ring, "learner_1")
    total = RunningSum.zero(session.member.push_sum.mass.size)
    session.member.receive_mass("learner_2", 1, 3, total)
    session.member._received_at["learner_4" if epoch > 1 else "learner_2"] = 0
    session.member.receive_mass("learner_2", epoch, iteration, total)
    assert iteration in session.member._inboxes[epoch]["learner_2"]


@pytest.mark.parametrize("epoch", [1, 2])
def test_iterations_begin_with_one(ring: Experiment, epoch: int) -> None:
    session = push_sum_session(ring, "learner_1")
    with pytest.raises(RefusedMessageError, match="iteration 0, expected more than 0") as error:
        session.member.receive_mass("learner_4", epoch, 0, some_sum(session))
    assert error.value.reason == "old_iteration"


def test_what_was_taken_last_is_old_in_its_epoch_only(ring: Experiment, streams: Streams) -> None:
    session = push_sum_session(ring, "learner_1")
    total = RunningSum.zero(session.member.push_sum.mass.size)
    session.receive_demonstration(1, streams["learner_1"][0])
    session.member.receive_mass("learner_2", 1, 1, total)
    session.member.give_up_waiting()
    session.step()
    session.member.receive_mass("learner_2", 2, 1, total)
    session.member.receive_mass("learner_2", 1, 2, total)
    with pytest.raises(RefusedMessageError, match="iteration 1, expected more than 1, taken last") as error:
        session.member.receive_mass("learner_2", 1, 1, total)
    assert error.value.reason == "old_iteration"
    session.member.receive_mass("learner_4", 1, 1, total)


def test_of_several_sums_the_newest_that_is_due_is_taken(ring: Experiment, streams: Streams) -> None:
    session = push_sum_session(ring, "learner_1")
    for n in (1, 2, 3):
        session.receive_demonstration(n, streams["learner_1"][n - 1])
    session.member.receive_mass("learner_2", 1, 1, some_sum(session, 0.1))
    session.member.receive_mass("learner_2", 1, 3, some_sum(session, 0.3))
    session.member.receive_mass("learner_4", 1, 3, some_sum(session, 0.4))
    taken = []
    while session.iteration <= 3:
        session.member.give_up_waiting()
        assert session.ready
        taken.append({name: value for name, value in session.step().items() if name.startswith("weight_received")})
    assert taken == [
        {"weight_received.learner_2": 0.1},
        {"weight_received.learner_2": 0.1},
        {"weight_received.learner_2": 0.3, "weight_received.learner_4": 0.4},
    ]
    assert (session.mixed_from, session.member._received_at) == (
        ["learner_2", "learner_4"],
        {"learner_2": 3, "learner_4": 3},
    )
    assert not any(session.member._inbox.values())


def test_a_neighbour_is_heard_once_something_of_this_iteration_or_a_later_one_came(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_1")
    session.member.state = session.state._replace(iteration=3)
    session.member.receive_mass("learner_2", 1, 2, some_sum(session))
    session.member.receive_mass("learner_4", 1, 4, some_sum(session))
    assert (session.missing_neighbours(), session.lag) == (["learner_2"], 1)
    session.member.receive_mass("learner_2", 1, 3, some_sum(session))
    assert (session.missing_neighbours(), session.lag) == ([], 1)


def test_the_lag_is_never_negative(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_1")
    assert session.lag == 0
    session.member.state = session.state._replace(iteration=3)
    session.member.receive_mass("learner_2", 1, 1, some_sum(session))
    assert session.lag == 0


def test_an_iteration_that_is_waited_for_no_longer_is_that_one_alone(ring: Experiment, streams: Streams) -> None:
    session = push_sum_session(ring, "learner_1")
    session.receive_demonstration(1, streams["learner_1"][0])
    session.member.give_up_waiting()
    session.step()
    assert session.missing_neighbours() == ["learner_2", "learner_4"]
    session.member.give_up_waiting()
    session.member.follow(2, list(reversed(NAMES)))
    assert session.missing_neighbours() == ["learner_2", "learner_4"], "the epoch is another"


def test_old_sums_make_room_for_new_ones(ring: Experiment) -> None:
    session = push_sum_session(ring, "learner_1", history=5)
    size = session.member.push_sum.mass.size
    for n in range(1, 11):
        session.member.receive_mass("learner_2", 1, n, RunningSum.zero(size).plus(np.full(size, float(n))))
    assert sorted(session.member._inbox["learner_2"]) == [6, 7, 8, 9, 10]


def test_survivors_go_on_after_a_declared_departure(ring: Experiment, streams: Streams) -> None:
    network = LossyNetwork(ring, streams, seed=1, loss=0.1)
    while min(session.iteration for session in network.sessions.values()) < 8:
        name = network.rng.choice(NAMES)
        network.tell(name)
        network.update(name)
    departed = network.sessions.pop("learner_4")
    for session in network.sessions.values():
        estimate = session.parameters
        session.member.follow(2, ["learner_1", "learner_2", "learner_3"])
        np.testing.assert_array_equal(session.parameters.theta, estimate.theta)
    network.run()
    assert network.weight() == pytest.approx(3, abs=1e-12)
    assert all(session.iteration == 21 for session in network.sessions.values())
    departed.member.follow(2, ["learner_1", "learner_2", "learner_3"])
    assert departed.finished
    assert departed.member.outgoing() == {}


def test_a_late_joiner_enters_without_mass_at_the_iteration_of_the_others(ring: Experiment, streams: Streams) -> None:
    founders = ["learner_1", "learner_2", "learner_3"]
    network = LossyNetwork(ring, streams, seed=2, loss=0.0)
    del network.sessions["learner_4"]
    for session in network.sessions.values():
        session.member.follow(2, founders)
    while min(session.iteration for session in network.sessions.values()) < 10:
        name = network.rng.choice(founders)
        network.tell(name)
        network.update(name)
    late_joiner = push_sum_session(ring, "learner_4", late_joiner=True)
    assert late_joiner.waiting_for()[-1] == "membership"
    network.sessions["learner_4"] = late_joiner
    for session in network.sessions.values():
        session.member.follow(3, list(NAMES))
    assert network.weight() == pytest.approx(3)
    assert late_joiner.member.push_sum.weight == 0.0
    assert late_joiner.member.joining
    network.tell("learner_3")
    giver = network.sessions["learner_3"]
    assert (late_joiner.member.joining, late_joiner.iteration) == (False, giver.iteration)
    np.testing.assert_allclose(late_joiner.parameters.theta, giver.parameters.theta, rtol=1e-9, atol=1e-12)
    network.run()
    assert network.weight() == pytest.approx(3, abs=1e-12)
    assert late_joiner.iteration == 21


@pytest.mark.parametrize(
    ("epoch", "members", "reason", "words"),
    [
        (1, ["learner_1"], "conflict", "epoch 1 has begun with other members"),
        (1, list(NAMES), "old_epoch", "epoch 1, expected more than 1"),
        (0, ["learner_1"], "old_epoch", "epoch 0, expected more than 1"),
        (2**32 - 1, ["learner_1"], "future_epoch", "epoch 4294967295, expected at most 17"),
        (2, ["learner_1", "learner_3"], "impossible_schedule", "nothing that learner_1 knows ever reaches learner_3"),
        (2, ["learner_1", "nobody"], "impossible_schedule", "expected some of the learners"),
        (2, [], "impossible_schedule", "expected some of the learners"),
    ],
)
def test_declarations_that_cannot_be_followed_are_refused(
    ring: Experiment, epoch: int, members: list[str], reason: str, words: str
) -> None:
    session = push_sum_session(ring, "learner_1")
    with pytest.raises(RefusedMessageError, match=words) as error:
        session.member.follow(epoch, members)
    assert error.value.reason == reason
    assert (session.epoch, session.member.members) == (1, NAMES)


@pytest.mark.parametrize("seed", range(2))
def test_restarts_lose_no_mass(ring: Experiment, streams: Streams, seed: int) -> None:
    """Every learner is replaced now and then by one that went on from its checkpoint."""
    network = LossyNetwork(ring, streams, seed, loss=0.2)
    while active := [name for name, session in network.sessions.items() if not session.finished]:
        name = network.rng.choice(active)
        network.tell(name)
        network.update(name)
        if network.rng.random() < 0.3:
            session = network.sessions[name]
            again = push_sum_session(ring, name)
            again.restore({session.iteration: {key: values.copy() for key, values in session.arrays().items()}})
            assert again.member.metrics() == session.member.metrics()
            assert (again.epoch, again.member.members, again.member._received_at) == (
                1,
                NAMES,
                session.member._received_at,
            )
            network.sessions[name] = again
    assert network.weight() == pytest.approx(4, abs=1e-12)


def test_restarts_in_step_and_without_loss_change_no_bit_with_the_default_rule(
    make_experiment: Callable[..., Path],
) -> None:
    change = {"mixing": {"kind": "resilient"}, "algorithm": {}}
    schedule = {"kind": "static", "graph": "ring"}
    experiment = load_experiment(make_experiment(learners=4, iterations=8, schedule=schedule, change=change))
    network = LossyNetwork(experiment, demonstrations(experiment), seed=0, loss=0.0)
    expected = simulate(experiment, network.streams)
    for n in range(1, experiment.iterations + 1):
        for name in NAMES:
            network.tell(name)
        for name in NAMES:
            network.update(name)
            assert bits(network.sessions[name].parameters) == bits(expected[name][n])
            arrays = {key: values.copy() for key, values in network.sessions[name].arrays().items()}
            network.sessions[name] = push_sum_session(experiment, name)
            network.sessions[name].restore({n + 1: arrays})


def test_a_checkpoint_holds_state_masses_and_membership(ring: Experiment, streams: Streams) -> None:
    """By the names that earlier versions wrote."""
    network = LossyNetwork(ring, streams, seed=0, loss=0.0)
    for name in NAMES:
        network.tell(name)
    network.update("learner_1")
    arrays = network.sessions["learner_1"].arrays()
    neighbours = ("learner_2", "learner_4")
    masses = {"mass", *(f"mass.{side}.{name}" for side in ("given", "taken") for name in neighbours)}
    own = {name for name in arrays if not name.startswith(("observed.", "steps."))}
    assert own == {"theta", "omega", "epoch", "members", "taken_at", "mixed_from", SHOWN} | masses
    assert arrays["mass"].shape == (arrays["theta"].size + arrays["omega"].size + 1,)
    assert arrays["mass.given.learner_2"].shape == (2, arrays["mass"].size)
    assert arrays["taken_at"].tolist() == [[1.0, 1.0], [3.0, 1.0]]
    assert (arrays["epoch"].tolist(), arrays["members"].tolist()) == ([1.0, 0.0, 1.0], [0.0, 1.0, 2.0, 3.0])


def test_a_strict_learner_is_no_member_by_push_sum(make_experiment: Callable[..., Path]) -> None:
    learner = build_learner(load_experiment(make_experiment()), "learner_1")
    with pytest.raises(ExperimentError, match="mixing is strict, expected resilient"):
        PushSumMember(learner, Limits(1, 256, 64))
