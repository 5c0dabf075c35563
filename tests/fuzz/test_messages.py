"""Messages of any content: the conversions return what fits or refuse by name, and sessions learn as if undisturbed."""

from collections import Counter
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from junk import made_up, spoil, spoiled
from mabirds_msgs.msg import Demonstration
from mabirds_msgs.msg import EdgeSchedule as EdgeScheduleMessage
from mabirds_msgs.msg import Parameters as ParametersMessage
from truth import Truth, bits, disturbed, true_messages, without_forgeries

from mabirds_core.algorithm.parameters import MAX_PARAMETER, Parameters
from mabirds_core.errors import MabirdsError, RefusedMessageError
from mabirds_core.experiment.assembly import build_learner, build_method
from mabirds_core.experiment.simulate import simulate_central
from mabirds_learner.baseline_session import BaselineSession
from mabirds_learner.inbox import check_iteration
from mabirds_learner.learner_session import OTHER_BAG, LearnerSession
from mabirds_learner.member import Limits
from mabirds_learner.strict_member import StrictMember
from mabirds_msgs_py.conversion import arrays, read_schedule

REASONS = {
    "wrong_learner",
    "wrong_game",
    "wrong_experiment",
    "wrong_schedule",
    "wrong_shape",
    "not_finite",
    "too_large",
    "impossible_trajectory",
    "impossible_schedule",
    "old_iteration",
    OTHER_BAG,
    "future_iteration",
    "duplicate",
    "conflict",
}

MAX_LENGTH = 1000
"""Characters of a refusal, whatever the message was."""

EXAMPLES = pytest.mark.parametrize("examples", [150, pytest.param(5000, marks=pytest.mark.slow)])
SESSIONS = pytest.mark.parametrize("examples", [20, pytest.param(500, marks=pytest.mark.slow)])


def many(examples: int) -> settings:
    return settings(max_examples=examples, deadline=None)


def either(message: Callable[[], Any]) -> st.SearchStrategy[Any]:
    """A sound message spoiled, or one that is made up."""
    return st.one_of(spoiled(message), made_up(type(message())))


def refusal(read: Callable[[], Any]) -> str | None:
    """The reason of a refusal, which must be a documented one with a short text; None for what is read."""
    refused: RefusedMessageError | None = None
    try:
        read()
    except RefusedMessageError as error:
        refused = error
    if refused is None:
        return None
    assert refused.reason in REASONS
    assert 0 < len(str(refused)) < MAX_LENGTH
    assert str(refused).isprintable()
    return refused.reason


@EXAMPLES
def test_a_demonstration_is_one_of_the_game_or_refused(truth: Truth, examples: int) -> None:
    @many(examples)
    @given(either(lambda: truth.demonstration("learner_1", 1)))
    def check(message: Demonstration) -> None:
        if refusal(lambda: truth.read_demonstration("learner_1", message)) is None:
            states, actions = truth.game.encode(truth.read_demonstration("learner_1", message))
            assert np.array_equal(states.ravel(), message.states)
            assert np.array_equal(actions.ravel(), message.actions)

    check()


@EXAMPLES
def test_parameters_are_numbers_of_the_right_size_or_refused(truth: Truth, examples: int) -> None:
    like = truth.history["learner_2"][0]

    @many(examples)
    @given(either(lambda: truth.parameters("learner_2", 1)))
    def check(message: ParametersMessage) -> None:
        if refusal(lambda: truth.read_parameters("learner_2", message)) is None:
            found = truth.read_parameters("learner_2", message)
            assert bits(found) == (message.theta.tobytes(), message.omega.tobytes())
            assert [one.shape for one in found] == [one.shape for one in like]
            assert all((np.abs(one) <= MAX_PARAMETER).all() for one in found)
        refusal(lambda: arrays(message))

    check()


@EXAMPLES
def test_a_schedule_message_is_what_its_digest_says_or_refused(truth: Truth, examples: int) -> None:
    @many(examples)
    @given(either(truth.schedule))
    def check(message: EdgeScheduleMessage) -> None:
        if refusal(lambda: read_schedule(message)) is None:
            assert read_schedule(message) == truth.experiment.edge_schedule

    check()


class Fed:
    """A session that gets messages as its node does, and counts refusals."""

    def __init__(self, truth: Truth, session: LearnerSession[StrictMember] | BaselineSession) -> None:
        self.truth, self.session = truth, session
        self.found = [session.parameters]
        self.dropped: Counter[str] = Counter()

    def feed(self, sender: str, message: Any) -> None:
        """As sent on the topic of ``sender``."""
        try:
            self._receive(sender, message)
        except RefusedMessageError as error:
            self.dropped[error.reason] += 1
        while self.session.ready:
            self.session.step()
            self.found.append(self.session.parameters)

    def _receive(self, sender: str, message: Any) -> None:
        if isinstance(message, ParametersMessage):
            assert isinstance(self.session, LearnerSession)
            parameters = self.truth.read_parameters(sender, message)
            self.session.member.receive_parameters(sender, message.iteration, parameters)
            return
        trajectory = self.truth.read_demonstration(sender, message)
        if isinstance(self.session, BaselineSession):
            self.session.receive_demonstration(sender, message.iteration, trajectory)
        else:
            self.session.receive_demonstration(message.iteration, trajectory)


def strict_session(truth: Truth) -> LearnerSession[StrictMember]:
    learner = build_learner(truth.experiment, "learner_1", truth.game)
    return LearnerSession(StrictMember(learner, Limits(truth.experiment.iterations, 10, 64)))


@SESSIONS
@pytest.mark.parametrize("end", ["repeat", "stop"])
def test_a_learner_learns_the_same_bits_whatever_else_is_sent(
    make_truth: Callable[..., Truth], end: str, examples: int
) -> None:
    slots = [[["learner_1", "learner_2"]], []] * 3
    truth = make_truth(schedule={"kind": "slots", "slots": slots, "undirected": True, "end": end})

    @many(examples)
    @given(disturbed(lambda: true_messages(truth, ["learner_1"], ["learner_2"])))
    def check(messages: list[tuple[str, Any]]) -> None:
        fed = Fed(truth, strict_session(truth))
        for sender, message in without_forgeries(truth, messages):
            fed.feed(sender, message)
        # A lie about the newest one is taken for another bag until the player, which sees it waited for, repeats.
        for sender, message in true_messages(truth, ["learner_1"], []) if fed.dropped[OTHER_BAG] else ():
            fed.feed(sender, message)
        assert [bits(one) for one in fed.found] == [bits(one) for one in truth.history["learner_1"]]
        assert fed.dropped.keys() <= REASONS

    check()


@SESSIONS
def test_a_central_method_learns_the_same_bits_whatever_else_is_sent(truth: Truth, examples: int) -> None:
    experiment = truth.experiment
    names, numbers = list(experiment.learners), range(experiment.iterations)
    read = {name: [truth.read_demonstration(name, truth.demonstration(name, n + 1)) for n in numbers] for name in names}
    expected = [bits(one) for one in simulate_central(experiment, "bics", read)["bics"]]

    @many(examples)
    @given(disturbed(lambda: true_messages(truth, names, [])))
    def check(messages: list[tuple[str, Any]]) -> None:
        fed = Fed(
            truth, BaselineSession(build_method(experiment, "bics", truth.game), names, experiment.iterations, 10)
        )
        for sender, message in without_forgeries(truth, messages):
            fed.feed(sender, message)
        assert [bits(one) for one in fed.found] == expected

    check()


ONE, OTHER = (Parameters(np.array([1.0, value]), np.zeros(1)) for value in (0.0, -0.0))


@pytest.mark.parametrize(
    ("iteration", "content", "reason", "text"),
    [
        (4, ONE, "old_iteration", "iteration 4, expected 5 or later"),
        (0, ONE, "old_iteration", "iteration 0, expected 5 or later"),
        (6, ONE, "duplicate", "iteration 6 has arrived before"),
        (6, OTHER, "conflict", "iteration 6 has arrived before with other content, which is kept; who else sends it?"),
        (15, ONE, "future_iteration", "iteration 15, expected less than 15"),
        (2**64 - 1, ONE, "future_iteration", "iteration 18446744073709551615, expected less than 15"),
    ],
)
def test_a_repetition_is_told_from_a_contradiction(iteration: int, content: Parameters, reason: str, text: str) -> None:
    """Minus zero is another content than zero: bits are compared."""
    with pytest.raises(RefusedMessageError) as refused:
        check_iteration(iteration, 5, {6: ONE}, 10, content)
    assert (refused.value.reason, str(refused.value)) == (reason, text)
    check_iteration(5, 5, {6: ONE}, 10, content)
    check_iteration(14, 5, {6: ONE}, 10, content)


def test_the_first_of_two_contents_stays_and_the_second_is_counted(truth: Truth) -> None:
    """A neighbour's parameters and a demonstration that somebody else sends once more with other content."""
    fed = Fed(truth, strict_session(truth))
    forged = truth.demonstration("learner_1", 3)
    forged.iteration = 1
    other = with_number(truth.parameters("learner_2", 1), "theta", 0, 1.0)
    for repetition in (1, 2):
        fed.feed("learner_2", truth.parameters("learner_2", 2))
        fed.feed("learner_1", truth.demonstration("learner_1", 2))
        assert fed.dropped["duplicate"] == 2 * (repetition - 1)
    fed.feed("learner_1", truth.demonstration("learner_1", 1))
    fed.feed("learner_1", forged)
    assert fed.dropped["conflict"] == 1
    fed.feed("learner_2", truth.parameters("learner_2", 1))
    fed.feed("learner_2", other)
    assert fed.dropped == {"duplicate": 2, "conflict": 1, "old_iteration": 1}
    assert [bits(one) for one in fed.found] == [bits(one) for one in truth.history["learner_1"][:3]]


def with_number(message: Any, field: str, place: int, value: float) -> Any:
    getattr(message, field)[place] = value
    return message


DIGEST = "d" * 100_000

DEMONSTRATIONS: list[tuple[Callable[[Demonstration], Any], str, str]] = [
    (lambda m: spoil(m, learner="learner_2"), "wrong_learner", "learner 'learner_2', expected 'learner_1'"),
    (lambda m: spoil(m, learner="\n\x1b[2J"), "wrong_learner", r"learner '\n\x1b[2J', expected 'learner_1'"),
    (lambda m: spoil(m, game_digest="other"), "wrong_game", "game digest 'other', expected"),
    (lambda m: spoil(m, experiment_digest=DIGEST), "wrong_experiment", "ddd... (100000 characters)', expected"),
    (lambda m: spoil(m, states=[], actions=[]), "wrong_shape", "states: 0 numbers, expected 8 x 4"),
    (lambda m: spoil(m, states=[0.0] * 33), "wrong_shape", "states: 33 numbers, expected 8 x 4"),
    (lambda m: spoil(m, steps=2**31), "wrong_shape", "states: 32 numbers, expected 2147483648 x 4"),
    (lambda m: spoil(m, steps=2**31, state_size=2**31), "wrong_shape", "expected 2147483648 x 2147483648"),
    (
        lambda m: spoil(m, steps=2**32 - 1, state_size=0, action_size=0, states=[], actions=[]),
        "impossible_trajectory",
        "states: shape (4294967295, 0), expected (8, 4)",
    ),
    (
        lambda m: spoil(m, steps=4, state_size=8, action_size=4),
        "impossible_trajectory",
        "shape (4, 8), expected (8, 4)",
    ),
    *(
        (
            lambda m, value=value: with_number(m, "states", 5, value),
            "impossible_trajectory",
            f"states at step 1, column 1: {value}, expected a whole number from 0 to 3",
        )
        for value in (float("nan"), float("inf"), -float("inf"), 1e300, 0.5, -1.0, 4.0, 5e-324)
    ),
    (
        lambda m: with_number(m, "actions", 0, 4.0),
        "impossible_trajectory",
        "actions at step 0, column 0: 4.0, expected",
    ),
    (
        lambda m: spoil(m, states=[0.0, 0.0, 2.0, 3.0] * 8, actions=[1.0] * 16),
        "impossible_trajectory",
        "step 0: expert 1 moves east from (0, 0) and is then at (0, 0); the game allows only (0, 1)",
    ),
]


@pytest.mark.parametrize(("change", "reason", "text"), DEMONSTRATIONS)
def test_unfit_demonstrations_say_what_is_wrong(
    truth: Truth, change: Callable[[Demonstration], Any], reason: str, text: str
) -> None:
    message = change(truth.demonstration("learner_1", 1))
    with pytest.raises(RefusedMessageError) as refused:
        truth.read_demonstration("learner_1", message)
    assert refused.value.reason == reason
    assert text in str(refused.value)
    assert len(str(refused.value)) < MAX_LENGTH


def test_minus_zero_is_zero_in_a_demonstration(truth: Truth) -> None:
    message = truth.demonstration("learner_1", 1)
    place = list(message.states).index(0.0)
    changed = with_number(message, "states", place, -0.0)
    found = truth.read_demonstration("learner_1", changed)
    true = truth.read_demonstration("learner_1", truth.demonstration("learner_1", 1))
    assert [one.tobytes() for one in found] == [one.tobytes() for one in true]


PARAMETERS: list[tuple[Callable[[ParametersMessage], Any], str, str]] = [
    (lambda m: spoil(m, learner="learner_1"), "wrong_learner", "learner 'learner_1', expected 'learner_2'"),
    (lambda m: spoil(m, experiment_digest=""), "wrong_experiment", "experiment digest '', expected"),
    (lambda m: spoil(m, schedule_digest="other"), "wrong_schedule", "schedule digest 'other', expected"),
    (lambda m: spoil(m, theta=[]), "wrong_shape", "theta: 0 numbers, expected 124"),
    (lambda m: spoil(m, omega=[0.0] * 27), "wrong_shape", "omega: 27 numbers, expected 26"),
    (lambda m: with_number(m, "theta", 3, float("nan")), "not_finite", "theta[3] is nan, expected a finite number"),
    (lambda m: with_number(m, "omega", 0, float("inf")), "not_finite", "omega[0] is inf, expected a finite number"),
    (lambda m: with_number(m, "omega", 9, -float("inf")), "not_finite", "omega[9] is -inf, expected a finite number"),
    (lambda m: with_number(m, "theta", 7, 1e300), "too_large", "theta[7] is 1e+300, expected at most 1e+12"),
    (lambda m: with_number(m, "omega", 7, -1.1e12), "too_large", "omega[7] is -1.1e+12, expected at most 1e+12"),
]


@pytest.mark.parametrize(("change", "reason", "text"), PARAMETERS)
def test_unfit_parameters_say_what_is_wrong(
    truth: Truth, change: Callable[[ParametersMessage], Any], reason: str, text: str
) -> None:
    message = change(truth.parameters("learner_2", 2))
    with pytest.raises(RefusedMessageError) as refused:
        truth.read_parameters("learner_2", message)
    assert refused.value.reason == reason
    assert text in str(refused.value)


def test_the_largest_parameters_are_accepted(truth: Truth) -> None:
    message = with_number(truth.parameters("learner_2", 2), "theta", 0, -MAX_PARAMETER)
    assert truth.read_parameters("learner_2", message).theta[0] == -MAX_PARAMETER


SCHEDULES: list[tuple[Callable[[EdgeScheduleMessage], Any], str, str]] = [
    (lambda m: spoil(m, digest=DIGEST), "wrong_schedule", "(100000 characters)' is not that of its content"),
    (lambda m: spoil(m, learners=["learner_1", "learner_3"]), "wrong_schedule", "is not that of its content"),
    (lambda m: spoil(m, sender=[0]), "wrong_shape", "edge_slot, sender and receiver: expected one number per edge"),
    (lambda m: spoil(m, sender=[0, 7]), "impossible_schedule", "edge learner number 7 -> learner_1: expected two"),
    (lambda m: spoil(m, edge_slot=[0, 2**32 - 1]), "impossible_schedule", "slot 4294967295, expected less than 1"),
    (lambda m: spoil(m, slots=2**32 - 1), "impossible_schedule", "4294967295 slots: expected at most 100000"),
    (lambda m: spoil(m, slots=0), "impossible_schedule", "slot 0, expected less than 0"),
    (lambda m: spoil(m, learners=[]), "impossible_schedule", "learners []: expected at least one"),
    (lambda m: spoil(m, learners=["a", "a"]), "impossible_schedule", "learners ['a', 'a']: expected at least one"),
]


@pytest.mark.parametrize(("change", "reason", "text"), SCHEDULES)
def test_unfit_schedules_say_what_is_wrong(
    truth: Truth, change: Callable[[EdgeScheduleMessage], Any], reason: str, text: str
) -> None:
    with pytest.raises(RefusedMessageError) as refused:
        read_schedule(change(truth.schedule()))
    assert refused.value.reason == reason
    assert text in str(refused.value)


@pytest.mark.parametrize("end", ["repeat", "hold", "stop"])
def test_every_sound_schedule_is_read_back(make_truth: Callable[..., Truth], end: str) -> None:
    slots = [[["learner_1", "learner_2"]]] * 6
    truth = make_truth(schedule={"kind": "slots", "slots": slots, "undirected": True, "end": end})
    assert read_schedule(truth.schedule()) == truth.experiment.edge_schedule


def test_every_refusal_is_an_error_of_the_project() -> None:
    assert issubclass(RefusedMessageError, MabirdsError)
