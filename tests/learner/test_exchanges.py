"""Exchanges without a node: an outlet that notes what it is asked for is all they need."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from mabirds_msgs.srv import FetchParameters

from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_game, build_learner
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_learner.exchange import Identity
from mabirds_learner.learner_session import LearnerSession
from mabirds_learner.member import Limits
from mabirds_learner.push_sum_exchange import PushSumExchange
from mabirds_learner.push_sum_member import PushSumMember
from mabirds_learner.strict_exchange import StrictExchange
from mabirds_learner.strict_member import StrictMember
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.conversion import parameters_message
from mabirds_msgs_py.mass_conversion import membership_message


class NotingOutlet:
    """Topics that were opened, what was published, asked, rejected and said; ``answer``: to every request."""

    def __init__(self, answer: Any = None) -> None:
        self.heard: dict[str, Callable[[Any], None]] = {}
        self.published: list[tuple[str, Any]] = []
        self.asked: list[tuple[str, int]] = []
        self.rejected: list[str] = []
        self.events: list[str] = []
        self.strangers: list[tuple[str, str]] = []
        self.answer, self.resets = answer, 0
        self.on_time: Callable[[], None] = lambda: None

    def publisher(self, message_type: type, topic: str) -> Callable[[Any], None]:
        return lambda message: self.published.append((topic, message))

    def subscribe(self, message_type: type, neighbour: str, topic: str, on_message: Callable[[Any], None]) -> None:
        self.heard[f"{neighbour}/{topic}"] = on_message

    def subscribe_to_all(self, message_type: type, topic: str, on_message: Callable[[Any], None], depth: int) -> None:
        self.heard[topic] = on_message

    def caller(self, service_type: type, neighbour: str, service: str) -> Callable[..., None]:
        def call(request: Any, on_response: Callable[[Any], None]) -> None:
            self.asked.append((f"{neighbour}/{service}", request.iteration))
            on_response(self.answer)

        return call

    def note_stranger(self, name: str, message: Any, error: RefusedMessageError) -> None:
        if error.reason == "wrong_experiment":
            self.strangers.append((name, message.experiment_digest))

    def timer(self, seconds: float, on_time: Callable[[], None]) -> "NotingOutlet":
        self.on_time = on_time
        return self

    def reset(self) -> None:
        self.resets += 1

    def stamp(self) -> Time:
        return Time(sec=7)

    def set_event(self, words: str, *, log: bool = True) -> None:
        self.events.append(words)

    def reject(self, what: str, error: RefusedMessageError) -> None:
        self.rejected.append(error.reason)


def identity(experiment: Experiment) -> Identity:
    return Identity("learner_1", experiment.digest, experiment.edge_schedule)


def strict(experiment: Experiment, outlet: NotingOutlet, changes: list[str]) -> StrictExchange:
    session = LearnerSession(StrictMember(build_learner(experiment, "learner_1"), Limits(4, 256, 64)))
    exchange = StrictExchange(session, identity(experiment), outlet, lambda: changes.append("changed"))
    exchange.connect()
    return exchange


def test_strict_parameters_are_taken_or_rejected_by_name(experiment: Experiment) -> None:
    outlet, changes = NotingOutlet(), list[str]()
    strict(experiment, outlet, changes)
    assert list(outlet.heard) == ["learner_2/parameters"]
    initial = build_learner(experiment, "learner_2").initial_state().parameters
    digests = experiment.digest, experiment.edge_schedule.digest
    message = parameters_message("learner_2", 1, initial, *digests, 0)
    outlet.heard["learner_2/parameters"](message)
    assert (changes, outlet.rejected) == (["changed"], [])
    message.experiment_digest = "other"
    outlet.heard["learner_2/parameters"](message)
    assert (changes, outlet.rejected) == (["changed"], ["wrong_experiment"])
    assert outlet.strangers == [("learner_2", "other")]


def test_what_a_strict_learner_lacks_for_a_period_is_asked_for(experiment: Experiment) -> None:
    outlet = NotingOutlet(FetchParameters.Response(found=False, message="keeps iterations 5 to 9"))
    exchange = strict(experiment, outlet, [])
    exchange.on_timer()
    assert outlet.asked == []
    exchange.on_timer()
    assert outlet.asked == [("learner_2/fetch_parameters", 1)]
    assert outlet.events == ["iteration 1 is missing: keeps iterations 5 to 9"]


@pytest.fixture
def resilient(make_experiment: Callable[..., Path]) -> Experiment:
    schedule, change = {"kind": "static", "graph": "ring"}, {"mixing": {"kind": "resilient"}}
    return load_experiment(make_experiment(learners=3, schedule=schedule, change=change))


def test_late_neighbours_are_waited_for_with_patience_and_declarations_are_saved_first(resilient: Experiment) -> None:
    outlet, said = NotingOutlet(), list[str]()
    session = LearnerSession(PushSumMember(build_learner(resilient, "learner_1"), Limits(4, 256, 64)))
    exchange = PushSumExchange(
        session,
        identity(resilient),
        outlet,
        lambda: said.append("changed"),
        patience=1.0,
        save=lambda: said.append(f"saved before {len(outlet.published)}"),
    )
    exchange.connect()
    assert set(outlet.heard) == {"learner_2/mass/learner_1", "learner_3/mass/learner_1", "membership"}
    assert [topic for topic, _ in outlet.published] == ["mass/learner_2", "mass/learner_3"]
    outlet.on_time()
    assert session.missing_neighbours() == ["learner_2", "learner_3"]  # as long as a demonstration is missing, too
    with DemonstrationBag(resilient.demonstrations.bag, build_game(resilient), resilient.learners) as bag:
        session.receive_demonstration(1, next(iter(bag.trajectories("learner_1"))))
    outlet.on_time()
    assert (session.missing_neighbours(), said) == ([], ["changed"])
    outlet.heard["membership"](membership_message(resilient.digest, 2, ["learner_1", "learner_2"]))
    assert said == ["changed", "saved before 2", "changed"]
    assert outlet.events == ["epoch 2: learner_1, learner_2"]
    assert [topic for topic, _ in outlet.published[2:]] == ["mass/learner_2"]
