"""Masses and declarations of any content: taken, or refused by name in few words, and a refusal changes nothing."""

from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mabirds_msgs.msg import Mass, Membership
from truth import Truth

from mabirds_core.consensus.push_sum import RunningSum
from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment
from mabirds_learner.learner_session import LearnerSession
from mabirds_learner.member import Limits
from mabirds_learner.push_sum_member import PushSumMember
from mabirds_msgs_py.mass_conversion import mass_message, read_mass, read_membership

NAMES = ["learner_1", "learner_2"]
MAX_LENGTH = 1000
"""Characters of a refusal, whatever was sent."""
IN_ONE_EXPERIMENT = settings(max_examples=150, suppress_health_check=[HealthCheck.function_scoped_fixture])

texts = st.text(max_size=200) | st.just("x" * 10_000) | st.sampled_from(NAMES)
numbers = st.floats() | st.sampled_from([1e13, 1e20, 1.1e20, -1e300, -0.0])
changes = st.fixed_dictionaries(
    {},
    optional={
        "learner": texts,
        "receiver": texts,
        "experiment_digest": texts,
        "schedule_digest": texts,
        "total": st.lists(numbers, max_size=4) | numbers.map(lambda number: [number] * 123),
        "rest": st.lists(numbers, max_size=4) | numbers.map(lambda number: [number] * 123),
    },
)


def session_of(experiment: Experiment) -> tuple[Experiment, LearnerSession[PushSumMember]]:
    resilient = Experiment.model_validate({**experiment.model_dump(mode="json"), "mixing": {"kind": "resilient"}})
    learner = build_learner(resilient, "learner_1")
    return resilient, LearnerSession(PushSumMember(learner, Limits(resilient.iterations, 256, 8)))


def receive(session: LearnerSession[PushSumMember], experiment: Experiment, message: Mass) -> str | None:
    """As the node does; why it was refused, or None."""
    digests = experiment.digest, experiment.edge_schedule.digest
    try:
        total = read_mass(message, "learner_2", "learner_1", *digests, session.member.push_sum.mass.size)
        session.member.receive_mass("learner_2", message.epoch, message.iteration, total)
    except RefusedMessageError as error:
        return f"{error.reason}: {error}"
    return None


@IN_ONE_EXPERIMENT
@given(change=changes, epoch=st.integers(0, 2**32 - 1) | st.just(1), iteration=st.integers(0, 2**64 - 1) | st.just(1))
def test_a_refused_mass_changes_nothing(truth: Truth, change: dict[str, Any], epoch: int, iteration: int) -> None:
    experiment, session = session_of(truth.experiment)
    size = session.member.push_sum.mass.size
    message = mass_message("learner_2", "learner_1", epoch, iteration, RunningSum.zero(size).plus(np.ones(size)))
    message.experiment_digest, message.schedule_digest = experiment.digest, experiment.edge_schedule.digest
    for name, value in change.items():
        setattr(message, name, value)
    before = session.parameters.theta.tobytes(), session.member.metrics(), session.member._newest(session.last)
    refusal = receive(session, experiment, message)
    if refusal is not None:
        assert len(refusal) < MAX_LENGTH
        assert (session.parameters.theta.tobytes(), session.member.metrics()) == before[:2]
        assert session.member._newest(session.last) == before[2]


@IN_ONE_EXPERIMENT
@given(members=st.lists(texts, max_size=5), epoch=st.integers(0, 2**32 - 1) | st.integers(0, 20), ours=st.booleans())
def test_a_declaration_is_followed_or_refused(truth: Truth, members: list[str], epoch: int, ours: bool) -> None:
    experiment, session = session_of(truth.experiment)
    digest = experiment.digest if ours else "other"
    message = Membership(experiment_digest=digest, epoch=epoch, members=members)
    refusal = None
    try:
        session.member.follow(message.epoch, read_membership(message, experiment.digest))
    except RefusedMessageError as error:
        refusal = str(error)
    if refusal is None:
        assert ours
        assert (session.epoch, set(session.member.members)) == (epoch, set(members))
    else:
        assert len(refusal) < MAX_LENGTH
        assert (session.epoch, list(session.member.members)) == (1, NAMES)
