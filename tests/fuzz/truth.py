"""What the processes of a small network say to each other while nobody disturbs them."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import strategies as st
from junk import made_up, spoiled
from mabirds_msgs.msg import Constraints, Demonstration, LearnerStatus
from mabirds_msgs.msg import EdgeSchedule as EdgeScheduleMessage
from mabirds_msgs.msg import Parameters as ParametersMessage

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History, simulate
from mabirds_core.games.interface import Trajectories
from mabirds_core.games.patrol.game import PatrolGame
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.constraints_conversion import constraints_message
from mabirds_msgs_py.conversion import parameters_message, read_demonstration, read_parameters, schedule_message


@dataclass(frozen=True)
class Truth:
    """What the processes of an experiment say to each other while nobody disturbs them."""

    file: Path
    experiment: Experiment
    messages: dict[str, list[Demonstration]]
    history: History

    @cached_property
    def game(self) -> PatrolGame:
        return build_game(self.experiment)

    @cached_property
    def digests(self) -> tuple[str, str]:
        return self.experiment.digest, self.experiment.edge_schedule.digest

    def demonstration(self, learner: str, iteration: int) -> Demonstration:
        message = copied(self.messages[learner][iteration - 1])
        message.experiment_digest = self.experiment.digest
        return message

    def parameters(self, learner: str, iteration: int) -> ParametersMessage:
        return parameters_message(learner, iteration, self.history[learner][iteration - 1], *self.digests, stamp=0)

    def read_demonstration(self, learner: str, message: Demonstration) -> Trajectories:
        """As ``learner`` reads it."""
        return read_demonstration(self.game, learner, message, self.experiment.digest)

    def read_parameters(self, sender: str, message: ParametersMessage) -> Parameters:
        """As the out-neighbours of ``sender`` read them."""
        return read_parameters(message, sender, *self.digests, self.history[sender][0])

    def status(self, speaker: str, /, **changes: Any) -> LearnerStatus:
        message = LearnerStatus(
            learner=speaker,
            game_digest=self.game.digest,
            experiment_digest=self.digests[0],
            schedule_digest=self.digests[1],
            iteration=1,
            metric_names=["seconds"],
            metric_values=[0.5],
            drop_reasons=["duplicate"],
            drop_counts=[1],
        )
        for name, value in changes.items():
            setattr(message, name, value)
        return message

    def constraints(self, learner: str) -> Constraints:
        names, confidences = self.game.cost_features.names, np.linspace(-1.0, 1.0, len(self.game.cost_features.names))
        message = constraints_message(names, confidences, self.experiment.constraint_confidence)
        message.learner, message.experiment_digest = learner, self.experiment.digest
        return message

    def schedule(self) -> EdgeScheduleMessage:
        return schedule_message(self.experiment.edge_schedule)


def copied(message: Any) -> Any:
    """A message of its own with the same fields."""
    copy = type(message)()
    for name in message.get_fields_and_field_types():
        value = getattr(message, name)
        nested = hasattr(value, "get_fields_and_field_types")
        setattr(copy, name, copied(value) if nested else value[:] if hasattr(value, "append") else value)
    return copy


def bits(parameters: Parameters) -> tuple[bytes, bytes]:
    return parameters.theta.tobytes(), parameters.omega.tobytes()


def truth_of(file: Path) -> Truth:
    experiment = load_experiment(file)
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        numbers = range(1, experiment.iterations + 1)
        messages = {name: [bag.message(name, n) for n in numbers] for name in experiment.learners}
        streams = {name: list(bag.trajectories(name)) for name in experiment.learners}
    return Truth(file, experiment, messages, simulate(experiment, streams))


def true_messages(truth: Truth, demonstrators: list[str], neighbours: list[str]) -> Iterator[tuple[str, Any]]:
    for n in range(1, truth.experiment.iterations + 1):
        yield from ((name, truth.demonstration(name, n)) for name in demonstrators)
        yield from ((name, truth.parameters(name, n)) for name in neighbours)


@st.composite
def disturbed(draw: st.DrawFn, make: Callable[[], Iterator[tuple[str, Any]]]) -> list[tuple[str, Any]]:
    """All messages in any order, some of them twice, with junk on the same topics in between."""
    messages = list(make())
    order = draw(st.permutations([*messages, *draw(st.lists(st.sampled_from(messages), max_size=3))]))
    disturbances = []
    for sender, message in draw(st.lists(st.sampled_from(messages), max_size=12)):
        junk = draw(st.one_of(spoiled(partial(copied, message)), made_up(type(message))))
        disturbances.append((draw(st.integers(0, len(order))), (sender, junk)))
    for place, junk in sorted(disturbances, key=lambda one: one[0], reverse=True):
        order.insert(place, junk)
    return order


def without_forgeries(truth: Truth, messages: Iterable[tuple[str, Any]]) -> Iterator[tuple[str, Any]]:
    """What is sent, each with the learner on whose topic, but for forgeries that come before what they forge.

    Something else than the truth that fits in every respect cannot be told from it without signatures: the first is
    kept. After the truth it must change nothing.
    """
    heard: set[tuple[str, type, int]] = set()
    for sender, message in messages:
        content = _content(truth, sender, message)
        place = sender, type(message), message.iteration
        if content is None or not 1 <= message.iteration <= truth.experiment.iterations:
            yield sender, message
        elif content == _content(truth, sender, _true(truth, sender, message)):
            heard.add(place)
            yield sender, message
        elif place in heard:
            yield sender, message


def _true(truth: Truth, sender: str, message: Any) -> Any:
    if isinstance(message, Demonstration):
        return truth.demonstration(sender, message.iteration)
    return truth.parameters(sender, message.iteration)


def _content(truth: Truth, sender: str, message: Any) -> tuple[bytes, ...] | None:
    """Every bit of what a receiver takes from a message; None: nothing."""
    try:
        if isinstance(message, Demonstration):
            return tuple(one.tobytes() for one in truth.read_demonstration(sender, message))
        return bits(truth.read_parameters(sender, message))
    except RefusedMessageError:
        return None
