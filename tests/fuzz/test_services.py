"""Services asked for the impossible: the answer says what was expected, and nothing changes."""

import math
import time
from collections.abc import Callable
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from hypothesis import given, settings
from hypothesis import strategies as st
from junk import TEXTS, spoil, whole_numbers
from mabirds_msgs.msg import Demonstration, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from mabirds_msgs.srv import FetchParameters, Resend
from rcl_interfaces.msg import Parameter as ParameterMessage
from rcl_interfaces.srv import SetParameters
from rclpy.parameter import Parameter
from truth import Truth, bits, true_messages

from mabirds_msgs_py.player_services import service_type
from mabirds_msgs_py.qos import STATUS_QOS, announced, latched

MAX_LENGTH = 1000
"""Characters of an answer, whatever was asked."""


@pytest.fixture
def long(make_truth: Callable[..., Truth]) -> Truth:
    return make_truth(iterations=20)


class Player:
    """A player, and learners that have learned nothing yet."""

    def __init__(self, nodes: Any, truth: Truth, **parameters: Any) -> None:
        self.nodes, self.truth, self.node = nodes, truth, nodes.plain("caller")
        self.player = nodes.player(truth.file, **parameters)
        self.received: list[tuple[str, int]] = []
        self._clients: dict[str, Any] = {}
        for name in truth.experiment.learners:
            self.node.create_subscription(Demonstration, f"/{name}/demonstration", self._receive, latched(256))
            publisher = self.node.create_publisher(LearnerStatus, f"/{name}/status", STATUS_QOS)
            publisher.publish(truth.status(name))

    def _receive(self, message: Demonstration) -> None:
        self.received.append((message.learner, message.iteration))

    def call(self, kind: Any, name: str, **fields: Any) -> Any:
        if name not in self._clients:
            self._clients[name] = self.node.create_client(kind, f"/expert_player/{name}")
        return self.nodes.call(self._clients[name], kind.Request(**fields))


@pytest.mark.parametrize("iteration", [0, 2, 2**63, 2**64 - 1])
def test_parameters_that_are_not_kept_are_not_found(truth: Truth, nodes: Any, iteration: int) -> None:
    nodes.learner(truth.file, "learner_1")
    client = nodes.plain().create_client(FetchParameters, "/learner_1/fetch_parameters")
    answer = nodes.call(client, FetchParameters.Request(iteration=iteration))
    assert not answer.found
    assert answer.message == "learner_1 keeps iterations 1 to 1"
    assert nodes.call(client, FetchParameters.Request(iteration=1)).found


def test_what_a_false_neighbour_answers_is_dropped_and_counted(truth: Truth, nodes: Any) -> None:
    """The neighbour's topic is silent; somebody else offers the service by which missing parameters are asked for."""
    impostor, statuses, asked = nodes.plain("impostor"), list[LearnerStatus](), list[int]()
    answers = [
        spoil(truth.parameters("learner_2", 1), learner="learner_3"),
        spoil(truth.parameters("learner_2", 1), theta=[0.0]),
        spoil(truth.parameters("learner_2", 1), omega=[math.nan] * 26),
        spoil(truth.parameters("learner_2", 1), iteration=2**64 - 1),
    ]

    def answer(request: FetchParameters.Request, response: FetchParameters.Response) -> FetchParameters.Response:
        asked.append(request.iteration)
        response.found, response.parameters = True, answers[len(asked) % len(answers)]
        return response

    impostor.create_service(FetchParameters, "/learner_2/fetch_parameters", answer)
    impostor.create_subscription(LearnerStatus, "/learner_1/status", statuses.append, latched(100))
    neighbour = impostor.create_publisher(ParametersMessage, "/learner_2/parameters", announced(10))
    player = impostor.create_publisher(Demonstration, "/learner_1/demonstration", latched(10))
    node = nodes.learner(truth.file, "learner_1", status_period=0.05)
    player.publish(truth.demonstration("learner_1", 1))
    reasons = {"wrong_learner", "wrong_shape", "not_finite", "future_iteration"}
    nodes.spin_until(lambda: statuses and reasons <= set(statuses[-1].drop_reasons))
    assert (node.session.iteration, set(asked)) == (1, {1})
    for sender, message in true_messages(truth, ["learner_1"], ["learner_2"]):
        (player if sender == "learner_1" else neighbour).publish(message)
    nodes.spin_until(lambda: node.session.finished)
    assert bits(node.session.parameters) == bits(truth.history["learner_1"][-1])


def test_no_more_than_the_window_is_played_however_much_is_asked_for(
    nodes: Any, long: Truth, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Any number of steps is no work where nothing may be sent, and the answer is what was."""
    monkeypatch.setattr("mabirds_expert_player.player_control.STEP_PATIENCE", 0.5)
    play, burst = Player(nodes, long, hz=100.0, max_in_flight=4), service_type("burst")
    assert play.call(burst, "burst", num_messages=1).actually_burst == 0
    assert play.player.answer == "no step: it is playing; pause it first"
    play.call(service_type("pause"), "pause")
    nodes.spin_until(lambda: all(stream.ready for stream in play.player.playback.streams.values()))
    start = time.process_time()
    published = [play.call(burst, "burst", num_messages=count).actually_burst for count in (2**64 - 1, 0, 2**32)]
    assert 0 < published[0] <= 8, "less what was sent before the pause"
    assert published[1:] == [0, 0]
    assert "held back by learner_1, learner_2" in play.player.answer
    assert time.process_time() - start < 5
    nodes.spin_until(lambda: len(play.received) == 8)
    assert sorted(play.received) == [(name, n) for name in ("learner_1", "learner_2") for n in (1, 2, 3, 4)]


@pytest.mark.parametrize(
    ("learner", "iteration", "text"),
    [
        ("nobody", 1, "'nobody' iteration 1: expected one of those sent, {'learner_1': 4, 'learner_2': 4}"),
        ("learner_1", 0, "'learner_1' iteration 0: expected one of those sent"),
        ("learner_1", 5, "'learner_1' iteration 5: expected one of those sent"),
        ("learner_1", 2**64 - 1, "'learner_1' iteration 18446744073709551615: expected one of those sent"),
        ("\n\x1b[2J", 1, r"'\n\x1b[2J' iteration 1: expected one of those sent"),
        ("x" * 100_000, 1, "xxx... (100000 characters)' iteration 1: expected"),
    ],
)
def test_what_was_never_sent_is_not_sent_again(
    nodes: Any, long: Truth, learner: str, iteration: int, text: str
) -> None:
    play = Player(nodes, long, hz=1000.0, max_in_flight=4)
    nodes.spin_until(lambda: len(play.received) == 8)
    answer = play.call(Resend, "resend", learner=learner, iteration=iteration)
    assert not answer.success
    assert text in answer.message
    assert len(answer.message) < MAX_LENGTH
    assert len(play.received) == 8


def parameter(name: str, value: Any) -> ParameterMessage:
    return Parameter(name, value=value).to_parameter_msg()


@pytest.mark.parametrize("name", ["rate", "hz"])
@pytest.mark.parametrize(
    ("value", "text"),
    [
        (math.nan, "out of range"),
        (math.inf, "out of range"),
        (-math.inf, "out of range"),
        (-1.0, "out of range"),
        (1e300, "out of range"),
        (10**18, "expected a number"),
        ("fast", "expected a number"),
        (True, "expected a number"),
        ([1.0, 2.0], "expected a number"),
        (None, "expected a number"),
    ],
    ids=str,
)
def test_speeds_that_are_none_are_refused_and_change_nothing(
    nodes: Any, long: Truth, name: str, value: Any, text: str
) -> None:
    play = Player(nodes, long, hz=1000.0, max_in_flight=4)
    before = play.player.get_parameter(name).value
    (result,) = play.call(SetParameters, "set_parameters", parameters=[parameter(name, value)]).results
    assert not result.successful
    assert text in result.reason
    assert play.player.get_parameter(name).value == before
    nodes.spin_until(lambda: len(play.received) == 8)


@pytest.mark.parametrize(("name", "value"), [("hz", 5e-324), ("hz", -0.0), ("hz", 1e-300), ("rate", 1e-6)])
def test_the_smallest_speeds_stop_nothing_but_the_player(nodes: Any, long: Truth, name: str, value: float) -> None:
    """What is due in ages is not sent, and a faster speed is obeyed at once."""
    play = Player(nodes, long, hz=0.0, max_in_flight=4)
    (result,) = play.call(SetParameters, "set_parameters", parameters=[parameter(name, value)]).results
    assert result.successful
    assert not play.player.done
    play.call(SetParameters, "set_parameters", parameters=[parameter("hz", 1000.0)])
    nodes.spin_until(lambda: len(play.received) == 8)


@pytest.mark.parametrize(("name", "value"), [("experiment", "/elsewhere"), ("run", "other"), ("max_in_flight", 200)])
def test_what_is_fixed_at_the_start_cannot_be_set(nodes: Any, long: Truth, name: str, value: Any) -> None:
    play = Player(nodes, long)
    (result,) = play.call(SetParameters, "set_parameters", parameters=[parameter(name, value)]).results
    assert not result.successful
    assert "read-only" in result.reason


def answered(node: Any, kind: Any, name: str, **fields: Any) -> Any:
    """The answer of a service of a node in this process."""
    (callback,) = [one.callback for one in node.services if one.service_name.endswith(name)]
    return callback(kind.Request(**fields), kind.Response())


def told_by(player: Any, name: str, **fields: Any) -> str:
    """Why a player answered as it did."""
    answered(player, service_type(name), f"/{name}", **fields)
    return str(player.answer)


@pytest.mark.parametrize("count", [50, pytest.param(2000, marks=pytest.mark.slow)])
def test_services_answer_whatever_is_asked(nodes: Any, long: Truth, count: int) -> None:
    """And the player goes on, with no demonstration sent beyond what may be in flight."""
    player, learner = nodes.player(long.file, hz=1e4, max_in_flight=4), nodes.learner(long.file, "learner_1")

    @settings(max_examples=count, deadline=None)
    @given(TEXTS, whole_numbers(64), whole_numbers(32), st.booleans())
    def check(name: str, iteration: int, steps: int, paused: bool) -> None:
        texts = [
            answered(player, Resend, "resend", learner=name, iteration=iteration).message,
            told_by(player, "pause" if paused else "resume"),
            told_by(player, "seek", time=Time(sec=steps >> 1, nanosec=steps)),
            told_by(player, "set_rate", rate=float(iteration)),
            answered(learner, FetchParameters, "fetch_parameters", iteration=iteration).message,
        ]
        assert all(len(text) < MAX_LENGTH and text.isprintable() for text in texts)
        assert all(stream.sent <= 4 for stream in player.playback.streams.values())

    check()
