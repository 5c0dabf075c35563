"""The newest parameters of several learners, of which the newest common iteration tells how far they are apart."""

from collections import defaultdict, deque
from typing import NamedTuple

from mabirds_msgs.msg import Parameters

from mabirds_core.metrics.metrics import consensus_distance
from mabirds_msgs_py.conversion import arrays

KEPT = 64
"""Iterations of a learner that are remembered."""


class Consensus(NamedTuple):
    """How far learners are from their mean.

    Attributes
    ----------
    iteration : int
        n.
    theta : float
        max_v || theta_v - mean theta ||.
    omega : float
        max_v || omega_v - mean omega ||.
    """

    iteration: int
    theta: float
    omega: float


class RecentParameters:
    """The last KEPT parameters of each learner."""

    def __init__(self) -> None:
        self._kept: defaultdict[str, deque[Parameters]] = defaultdict(lambda: deque(maxlen=KEPT))

    def note(self, name: str, message: Parameters) -> None:
        """Remember what a learner says; the same again is nothing new."""
        kept = self._kept[name]
        if not kept or kept[-1] is not message:
            kept.append(message)

    def consensus(self) -> Consensus | None:
        """At the newest iteration that is known of all, of which there are two or more; None where there is none."""
        by_name = [{message.iteration: message for message in kept} for kept in self._kept.values()]
        common = set.intersection(*map(set, by_name)) if len(by_name) > 1 else set()
        if not common:
            return None
        iteration = max(common)
        newest = [arrays(messages[iteration]) for messages in by_name]
        if len({(of_one.theta.size, of_one.omega.size) for of_one in newest}) > 1:
            return None  # of different games
        distances = (consensus_distance([getattr(of_one, part) for of_one in newest]) for part in ("theta", "omega"))
        return Consensus(iteration, *distances)
