"""Resilient mode without ROS: late neighbours, epochs, newcomers, and going on from checkpoints."""

import random
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mabirds_core.assembly import build_game, build_resilient_learner
from mabirds_core.experiment import Experiment, load_experiment
from mabirds_core.games.interface import Trajectories
from mabirds_core.push_sum import RunningSum
from mabirds_core.simulate import simulate_resilient
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


def new_session(experiment: Experiment, name: str, history: int = 64, **options: Any) -> ResilientSession:
    return ResilientSession(build_resilient_learner(experiment, name), experiment.iterations, 256, history, **options)


class LossyNetwork:
    """Sessions that tell each other what they gave, on links that lose at random."""

    def __init__(self, experiment: Experiment, streams: Streams, seed: int, loss: float) -> None:
        self.streams, self.rng, self.loss = streams, random.Random(seed), loss
        self.sessions = {name: new_session(experiment, name) for name in experiment.learners}
        self.lost = 0

    def tell(self, name: str) -> None:
        session = self.sessions[name]
        for receiver, total in session.given().items():
            if self.rng.random() < self.loss or receiver not in self.sessions:
                self.lost += 1
                continue
            with suppress(RefusedMessageError):  # told again, or contained in what was taken
                self.sessions[receiver].receive_sum(name, session.epoch, session.iteration, total)

    def update(self, name: str) -> None:
        session = self.sessions[name]
        if not session.finished and session.missing_demonstration:
            session.receive_demonstration(session.iteration, self.streams[name][session.iteration - 1])
        if not session.ready:
            session.stop_waiting()
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
        ledgers = {name: session.state.ledger for name, session in self.sessions.items()}
        under_way = sum(
            one.since(ledgers[receiver].taken.get(sender, RunningSum.zero(one.total.size)))[-1]
            for sender, ledger in ledgers.items()
            for receiver, one in ledger.given.items()
        )
        return float(under_way + sum(ledger.weight for ledger in ledgers.values()))


def test_in_step_and_without_loss_it_is_the_reference(experiment: Experiment, streams: Streams) -> None:
    network = LossyNetwork(experiment, streams, seed=0, loss=0.0)
    expected = simulate_resilient(experiment, streams)
    for n in range(1, experiment.iterations + 1):
        for name in NAMES:
            network.tell(name)
        for name in NAMES:
            network.update(name)
            assert network.sessions[name].parameters.theta.tobytes() == expected[name][n].theta.tobytes()
            assert network.sessions[name].mixed_from == sorted(
                experiment.learners[u] for u in experiment.edge_schedule.in_neighbours(NAMES.index(name), n)
            )


@pytest.mark.parametrize("seed", range(4))
def test_whatever_is_lost_and_whoever_is_ahead_no_mass_is_lost(
    experiment: Experiment, streams: Streams, seed: int
) -> None:
    network = LossyNetwork(experiment, streams, seed, loss=0.3)
    network.run()
    assert network.lost > 10
    assert network.weight() == pytest.approx(4, abs=1e-12)


def test_a_sum_ahead_of_its_time_waits(experiment: Experiment, streams: Streams) -> None:
    network = LossyNetwork(experiment, streams, seed=0, loss=0.0)
    session = network.sessions["learner_1"]
    session.receive_demonstration(1, streams["learner_1"][0])
    size = session.state.ledger.own.size
    session.receive_sum("learner_2", 1, 2, RunningSum.zero(size).plus(np.ones(size)))
    session.stop_waiting()
    assert session.weights()["weight"] == pytest.approx(1 / 3)
    session.step()
    assert session.mixed_from == []
    session.stop_waiting()
    session.receive_demonstration(2, streams["learner_1"][1])
    session.step()
    assert session.mixed_from == ["learner_2"]
    assert session.weights()["weight_taken.learner_2"] == 1.0


def test_only_a_neighbour_that_is_there_is_waited_for(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_1")
    assert session.waiting_for() == ["demonstration", "learner_2", "learner_4"]
    session.set_gone("learner_4", gone=True)
    assert session.missing_neighbours() == ["learner_2"]
    session.set_gone("learner_4", gone=False)
    assert session.missing_neighbours() == ["learner_2", "learner_4"]
    session.stop_waiting()
    assert session.missing_neighbours() == []


def test_a_learner_waits_for_whom_it_hears_and_tells_who_hears_it(make_experiment: Callable[..., Path]) -> None:
    change = {"mixing": {"kind": "resilient"}}
    settings = load_experiment(make_experiment(learners=4, schedule={"kind": "directed_ring"}, change=change))
    session = new_session(settings, "learner_1")
    assert (session.missing_neighbours(), list(session.given())) == (["learner_4"], ["learner_2"])


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
def test_what_is_known_or_out_of_reach_is_not_taken(
    experiment: Experiment, epoch: int, iteration: int, reason: str
) -> None:
    session = new_session(experiment, "learner_1")
    size = session.state.ledger.own.size
    session.receive_sum("learner_2", 1, 3, RunningSum.zero(size))
    session._taken_at["learner_2"] = 2
    with pytest.raises(RefusedMessageError) as error:
        session.receive_sum("learner_2", epoch, iteration, RunningSum.zero(size))
    assert error.value.reason == reason


@pytest.mark.parametrize(("epoch", "iteration"), [(1, 1), (1, 4), (1, 20), (2, 1), (2, 3), (17, 20)])
def test_what_is_new_and_within_reach_is_kept(experiment: Experiment, epoch: int, iteration: int) -> None:
    """Also at the very ends, and of another epoch whatever is known of this one."""
    session = new_session(experiment, "learner_1")
    total = RunningSum.zero(session.state.ledger.own.size)
    session.receive_sum("learner_2", 1, 3, total)
    session._taken_at["learner_4" if epoch > 1 else "learner_2"] = 0
    session.receive_sum("learner_2", epoch, iteration, total)
    assert iteration in session._inboxes[epoch]["learner_2"]


@pytest.mark.parametrize("epoch", [1, 2])
def test_iterations_begin_with_one(experiment: Experiment, epoch: int) -> None:
    session = new_session(experiment, "learner_1")
    with pytest.raises(RefusedMessageError, match="iteration 0, expected more than 0") as error:
        session.receive_sum("learner_4", epoch, 0, some_sum(session))
    assert error.value.reason == "old_iteration"


def test_what_was_taken_last_is_old_in_its_epoch_only(experiment: Experiment, streams: Streams) -> None:
    session = new_session(experiment, "learner_1")
    total = RunningSum.zero(session.state.ledger.own.size)
    session.receive_demonstration(1, streams["learner_1"][0])
    session.receive_sum("learner_2", 1, 1, total)
    session.stop_waiting()
    session.step()
    session.receive_sum("learner_2", 2, 1, total)
    session.receive_sum("learner_2", 1, 2, total)
    with pytest.raises(RefusedMessageError, match="iteration 1, expected more than 1, taken last") as error:
        session.receive_sum("learner_2", 1, 1, total)
    assert error.value.reason == "old_iteration"
    session.receive_sum("learner_4", 1, 1, total)


def some_sum(session: ResilientSession, value: float = 1.0) -> RunningSum:
    """Of weight ``value``, and theta and omega of sevens."""
    own = session.state.ledger.own
    return RunningSum.zero(own.size).plus(np.append(np.full(own.size - 1, 7 * value), value))


def test_of_several_sums_the_newest_that_is_due_is_taken(experiment: Experiment, streams: Streams) -> None:
    session = new_session(experiment, "learner_1")
    for n in (1, 2, 3):
        session.receive_demonstration(n, streams["learner_1"][n - 1])
    session.receive_sum("learner_2", 1, 1, some_sum(session, 0.1))
    session.receive_sum("learner_2", 1, 3, some_sum(session, 0.3))
    session.receive_sum("learner_4", 1, 3, some_sum(session, 0.4))
    taken = []
    while session.iteration <= 3:
        session.stop_waiting()
        assert session.ready
        taken.append({name: value for name, value in session.step().items() if name.startswith("weight_taken")})
    assert taken == [
        {"weight_taken.learner_2": 0.1},
        {"weight_taken.learner_2": 0.1},
        {"weight_taken.learner_2": 0.3, "weight_taken.learner_4": 0.4},
    ]
    assert (session.mixed_from, session._taken_at) == (["learner_2", "learner_4"], {"learner_2": 3, "learner_4": 3})
    assert not any(session._inbox.values())


def test_a_neighbour_is_heard_once_something_of_this_iteration_or_a_later_one_came(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_1")
    session.state = session.state._replace(learner=session.state.learner._replace(iteration=3))
    session.receive_sum("learner_2", 1, 2, some_sum(session))
    session.receive_sum("learner_4", 1, 4, some_sum(session))
    assert (session.missing_neighbours(), session.lag) == (["learner_2"], 1)
    session.receive_sum("learner_2", 1, 3, some_sum(session))
    assert (session.missing_neighbours(), session.lag) == ([], 1)


def test_the_lag_is_never_negative(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_1")
    assert session.lag == 0
    session.state = session.state._replace(learner=session.state.learner._replace(iteration=3))
    session.receive_sum("learner_2", 1, 1, some_sum(session))
    assert session.lag == 0


def test_an_iteration_that_is_waited_for_no_longer_is_that_one_alone(experiment: Experiment, streams: Streams) -> None:
    session = new_session(experiment, "learner_1")
    session.receive_demonstration(1, streams["learner_1"][0])
    session.stop_waiting()
    session.step()
    assert session.missing_neighbours() == ["learner_2", "learner_4"]
    session.stop_waiting()
    session.follow(2, list(reversed(NAMES)))
    assert session.missing_neighbours() == ["learner_2", "learner_4"], "the epoch is another"


def test_old_sums_make_room_for_new_ones(experiment: Experiment) -> None:
    session = new_session(experiment, "learner_1", history=5)
    size = session.state.ledger.own.size
    for n in range(1, 11):
        session.receive_sum("learner_2", 1, n, RunningSum.zero(size).plus(np.full(size, float(n))))
    assert sorted(session._inbox["learner_2"]) == [6, 7, 8, 9, 10]


def test_survivors_go_on_after_a_declared_departure(experiment: Experiment, streams: Streams) -> None:
    network = LossyNetwork(experiment, streams, seed=1, loss=0.1)
    while min(session.iteration for session in network.sessions.values()) < 8:
        name = network.rng.choice(NAMES)
        network.tell(name)
        network.update(name)
    departed = network.sessions.pop("learner_4")
    for session in network.sessions.values():
        estimate = session.parameters
        session.follow(2, ["learner_1", "learner_2", "learner_3"])
        np.testing.assert_array_equal(session.parameters.theta, estimate.theta)
    network.run()
    assert network.weight() == pytest.approx(3, abs=1e-12)
    assert all(session.iteration == 21 for session in network.sessions.values())
    departed.follow(2, ["learner_1", "learner_2", "learner_3"])
    assert departed.finished
    assert departed.given() == {}


def test_a_newcomer_enters_without_mass_at_the_iteration_of_the_others(
    experiment: Experiment, streams: Streams
) -> None:
    founders = ["learner_1", "learner_2", "learner_3"]
    network = LossyNetwork(experiment, streams, seed=2, loss=0.0)
    del network.sessions["learner_4"]
    for session in network.sessions.values():
        session.follow(2, founders)
    while min(session.iteration for session in network.sessions.values()) < 10:
        name = network.rng.choice(founders)
        network.tell(name)
        network.update(name)
    newcomer = new_session(experiment, "learner_4", newcomer=True)
    assert newcomer.waiting_for()[-1] == "membership"
    network.sessions["learner_4"] = newcomer
    for session in network.sessions.values():
        session.follow(3, list(NAMES))
    assert network.weight() == pytest.approx(3)
    assert newcomer.state.ledger.weight == 0.0
    assert newcomer.joining
    network.tell("learner_3")
    giver = network.sessions["learner_3"]
    assert (newcomer.joining, newcomer.iteration) == (False, giver.iteration)
    np.testing.assert_allclose(newcomer.parameters.theta, giver.parameters.theta, rtol=1e-9, atol=1e-12)
    network.run()
    assert network.weight() == pytest.approx(3, abs=1e-12)
    assert newcomer.iteration == 21


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
    experiment: Experiment, epoch: int, members: list[str], reason: str, words: str
) -> None:
    session = new_session(experiment, "learner_1")
    with pytest.raises(RefusedMessageError, match=words) as error:
        session.follow(epoch, members)
    assert error.value.reason == reason
    assert (session.epoch, session.members) == (1, NAMES)


@pytest.mark.parametrize("seed", range(2))
def test_restarts_lose_no_mass(experiment: Experiment, streams: Streams, seed: int) -> None:
    """Every learner is replaced now and then by one that went on from its checkpoint."""
    network = LossyNetwork(experiment, streams, seed, loss=0.2)
    while active := [name for name, session in network.sessions.items() if not session.finished]:
        name = network.rng.choice(active)
        network.tell(name)
        network.update(name)
        if network.rng.random() < 0.3:
            session = network.sessions[name]
            again = new_session(experiment, name)
            again.resume({session.iteration: {key: values.copy() for key, values in session.arrays().items()}})
            assert again.weights() == session.weights()
            assert (again.epoch, again.members, again._taken_at) == (1, NAMES, session._taken_at)
            network.sessions[name] = again
    assert network.weight() == pytest.approx(4, abs=1e-12)
