"""Sessions without ROS, and what they are sent, for several test files."""

from typing import Any

import numpy as np

from mabirds_core.consensus.push_sum import RunningSum
from mabirds_core.experiment.assembly import build_game, build_learner
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories
from mabirds_learner.learner_session import LearnerSession
from mabirds_learner.member import Limits
from mabirds_learner.push_sum_member import PushSumMember
from mabirds_msgs_py.bag_reader import DemonstrationBag

Streams = dict[str, list[Trajectories]]


def demonstrations(experiment: Experiment) -> Streams:
    """All that the experiment's bag holds."""
    with DemonstrationBag(experiment.demonstrations.bag, build_game(experiment), experiment.learners) as bag:
        return {name: list(bag.trajectories(name)) for name in experiment.learners}


def push_sum_session(
    experiment: Experiment, name: str, history: int = 64, **options: Any
) -> LearnerSession[PushSumMember]:
    """The session of a learner that mixes by push-sum."""
    limits = Limits(experiment.iterations, 256, history)
    return LearnerSession(PushSumMember(build_learner(experiment, name), limits, **options))


def some_sum(session: LearnerSession[PushSumMember], value: float = 1.0) -> RunningSum:
    """Of weight ``value``, and theta and omega of sevens."""
    size = session.member.push_sum.mass.size
    return RunningSum.zero(size).plus(np.append(np.full(size - 1, 7 * value), value))
