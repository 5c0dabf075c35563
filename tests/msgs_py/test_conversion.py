"""Messages: round trips, and each way in which a message can be unfit."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from mabirds_msgs.msg import Demonstration
from mabirds_msgs.msg import EdgeSchedule as EdgeScheduleMessage
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy.serialization import deserialize_message, serialize_message

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.digest import experiment_digest
from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.conversion import (
    demonstration_message,
    parameters_message,
    read_demonstration,
    read_parameters,
    schedule_message,
)
from mabirds_msgs_py.demonstration_origin import bag_of, played_to
from mabirds_msgs_py.topics import split_namespace

PARAMETERS = Parameters(np.array([1.5, -2.0, 1e-300]), np.array([0.1]))


def through_cdr(message: Any) -> Any:
    return deserialize_message(serialize_message(message), type(message))


def parameters() -> ParametersMessage:
    return parameters_message("learner_2", 7, PARAMETERS, "experiment", "schedule", stamp=5_000_000_001)


def read(message: ParametersMessage) -> Parameters:
    return read_parameters(message, "learner_2", "experiment", "schedule", PARAMETERS)


def test_parameters_survive_to_the_last_bit() -> None:
    result = read(through_cdr(parameters()))
    assert result.theta.tobytes() == PARAMETERS.theta.tobytes()
    assert result.omega.tobytes() == PARAMETERS.omega.tobytes()


def test_a_host_whose_last_bits_may_differ_is_refused_by_the_name_of_its_arithmetic() -> None:
    message = parameters()
    message.experiment_digest = experiment_digest([1], "numpy_2.4.6_avx2_haswell")
    ours = experiment_digest([1], "fixed")
    with pytest.raises(RefusedMessageError, match="arithmetic 'numpy_2.4.6_avx2_haswell', expected 'fixed'") as refused:
        read_parameters(message, "learner_2", ours, "schedule", PARAMETERS)
    assert refused.value.reason == "wrong_arithmetic"


def test_read_parameters_do_not_share_memory_with_the_message() -> None:
    message = parameters()
    result = read(message)
    message.theta[0] = 99.0
    assert result.theta[0] == 1.5


def set_field(name: str, value: Any) -> Callable[[Any], None]:
    return lambda message: setattr(message, name, value)


@pytest.mark.parametrize(
    ("spoil", "reason", "text"),
    [
        (set_field("learner", "learner_3"), "wrong_learner", "'learner_3', expected 'learner_2'"),
        (set_field("experiment_digest", "x"), "wrong_experiment", "experiment digest 'x', expected 'experiment'"),
        (set_field("schedule_digest", "x"), "wrong_schedule", "schedule digest 'x', expected 'schedule'"),
        (set_field("theta", [1.0]), "wrong_shape", "theta: 1 numbers, expected 3"),
        (set_field("omega", []), "wrong_shape", "omega: 0 numbers, expected 1"),
        (set_field("omega", [float("nan")]), "not_finite", "omega[0] is nan"),
        (set_field("theta", [0.0, float("-inf"), 0.0]), "not_finite", "theta[1] is -inf"),
    ],
)
def test_unfit_parameters_are_refused(spoil: Callable[[Any], None], reason: str, text: str) -> None:
    message = parameters()
    spoil(message)
    with pytest.raises(RefusedMessageError) as refused:
        read(message)
    assert refused.value.reason == reason
    assert text in str(refused.value)


@pytest.fixture
def demonstration(experiment: Experiment) -> Demonstration:
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        return bag.message("learner_1", 2)


def test_demonstrations_survive(experiment: Experiment, demonstration: Demonstration) -> None:
    game = build_game(experiment)
    trajectory = read_demonstration(game, "learner_1", through_cdr(demonstration))
    again = demonstration_message(game, "learner_1", 2, trajectory, stamp=0)
    assert list(again.states) == list(demonstration.states)
    assert list(again.actions) == list(demonstration.actions)


@pytest.mark.parametrize(
    ("spoil", "reason"),
    [
        (set_field("learner", "learner_2"), "wrong_learner"),
        (set_field("game_digest", ""), "wrong_game"),
        (set_field("steps", 3), "wrong_shape"),
        (set_field("state_size", 2**32 - 1), "wrong_shape"),
        (lambda message: message.states.pop(), "wrong_shape"),
        (lambda message: message.states.__setitem__(0, float("nan")), "impossible_trajectory"),
        (lambda message: message.states.__setitem__(0, 1e300), "impossible_trajectory"),
        (lambda message: message.actions.__setitem__(0, 0.5), "impossible_trajectory"),
        (lambda message: message.actions.__setitem__(0, -1.0), "impossible_trajectory"),
    ],
)
def test_unfit_demonstrations_are_refused(
    experiment: Experiment, demonstration: Demonstration, spoil: Callable[[Any], None], reason: str
) -> None:
    spoil(demonstration)
    with pytest.raises(RefusedMessageError) as refused:
        read_demonstration(build_game(experiment), "learner_1", demonstration)
    assert refused.value.reason == reason


def test_a_demonstration_names_its_bag(experiment: Experiment, demonstration: Demonstration) -> None:
    game, bag = build_game(experiment), "0" * 64
    for named, found in ((played_to(experiment.digest, bag), bag), (played_to(experiment.digest, ""), ""), ("", "")):
        demonstration.experiment_digest = named
        message = through_cdr(demonstration)
        read_demonstration(game, "learner_1", message, experiment.digest)
        assert bag_of(message) == found
    assert played_to(experiment.digest, "") == experiment.digest


def test_another_network_with_a_bag_is_refused(experiment: Experiment, demonstration: Demonstration) -> None:
    demonstration.experiment_digest = played_to("v4-fixed-0", "0" * 64)
    with pytest.raises(RefusedMessageError, match="v4-fixed-0', expected") as refused:
        read_demonstration(build_game(experiment), "learner_1", demonstration, experiment.digest)
    assert refused.value.reason == "wrong_experiment"


@pytest.mark.parametrize("bag", ["0" * 63, "G" * 64, "0 1", " "])
def test_what_is_no_digest_of_a_bag_is_refused(demonstration: Demonstration, bag: str) -> None:
    demonstration.experiment_digest = f"v4-fixed-0 {bag}"
    with pytest.raises(RefusedMessageError, match="expected 64 digits") as refused:
        bag_of(demonstration)
    assert refused.value.reason == "wrong_experiment"


def test_a_schedule_message_tells_the_whole_schedule() -> None:
    schedule = EdgeSchedule(("a", "b", "c"), (frozenset({(0, 1), (1, 0)}), frozenset(), frozenset({(2, 1), (1, 2)})))
    message: EdgeScheduleMessage = through_cdr(schedule_message(schedule))
    slots: list[set[tuple[int, int]]] = [set() for _ in range(message.slots)]
    for slot, sender, receiver in zip(message.edge_slot, message.sender, message.receiver, strict=True):
        slots[slot].add((sender, receiver))
    rebuilt = replace(schedule, learners=tuple(message.learners), slots=tuple(map(frozenset, slots)))
    assert rebuilt.digest == message.digest == schedule.digest


def test_namespaces_give_fleet_and_name() -> None:
    assert split_namespace("/learner_1") == ("/", "learner_1")
    assert split_namespace("/depot/fleet/learner_1") == ("/depot/fleet/", "learner_1")
