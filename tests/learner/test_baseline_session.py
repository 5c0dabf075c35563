"""The baseline session: an update once all streams are there, and what it refuses."""

import numpy as np
import pytest

from mabirds_core.errors import RefusedMessageError
from mabirds_core.experiment.assembly import build_game, build_method
from mabirds_core.experiment.file import Experiment
from mabirds_core.experiment.simulate import simulate_central
from mabirds_core.games.interface import Trajectories
from mabirds_expert_player.recorder import expert_streams
from mabirds_learner.baseline_session import BaselineSession

HISTORY = 4


@pytest.fixture
def streams(experiment: Experiment) -> dict[str, list[Trajectories]]:
    return {name: list(stream) for name, stream in expert_streams(experiment, build_game(experiment)).items()}


@pytest.fixture
def session(experiment: Experiment) -> BaselineSession:
    return BaselineSession(build_method(experiment, "bics"), experiment.learners, experiment.iterations, HISTORY)


def test_it_waits_for_every_stream_and_names_those_that_are_missing(
    session: BaselineSession, streams: dict[str, list[Trajectories]]
) -> None:
    assert session.waiting_for() == ["learner_1", "learner_2"]
    session.receive_demonstration("learner_2", 1, streams["learner_2"][0])
    assert (session.waiting_for(), session.ready, session.missing_demonstration) == (["learner_1"], False, True)
    session.receive_demonstration("learner_1", 2, streams["learner_1"][1])
    assert (session.ready, session.backlog) == (False, 2)
    session.receive_demonstration("learner_1", 1, streams["learner_1"][0])
    assert (session.waiting_for(), session.ready) == ([], True)
    assert session.step() == {"gradient_steps": 1.0, "policy_solves": 1.0}
    assert (session.iteration, session.waiting_for(), session.backlog) == (2, ["learner_2"], 1)


def test_the_order_of_arrival_does_not_matter(
    experiment: Experiment, session: BaselineSession, streams: dict[str, list[Trajectories]]
) -> None:
    expected = simulate_central(experiment, "bics", streams)["bics"][-1]
    rng, pending = np.random.default_rng(0), [(name, n) for n in range(1, 7) for name in streams]
    while pending:
        within = [(name, n) for name, n in pending if n < session.iteration + HISTORY]
        name, n = within[rng.integers(len(within))]
        pending.remove((name, n))
        session.receive_demonstration(name, n, streams[name][n - 1])
        while session.ready:
            session.step()
    assert session.finished
    assert session.parameters.theta.tobytes() == expected.theta.tobytes()
    assert session.parameters.omega.tobytes() == expected.omega.tobytes()


def test_old_repeated_and_far_demonstrations_are_refused_by_reason(
    session: BaselineSession, streams: dict[str, list[Trajectories]]
) -> None:
    one = streams["learner_1"][0]
    session.receive_demonstration("learner_1", 1, one)
    for iteration, reason in ((0, "old_iteration"), (1, "duplicate"), (1 + HISTORY, "future_iteration")):
        with pytest.raises(RefusedMessageError) as caught:
            session.receive_demonstration("learner_1", iteration, one)
        assert caught.value.reason == reason
    session.receive_demonstration("learner_2", 1, one)
    assert session.ready
