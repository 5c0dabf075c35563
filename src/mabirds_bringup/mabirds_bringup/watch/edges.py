"""What has become of the edges that the schedule opens just now, by what their receivers say."""

from collections.abc import Mapping
from typing import Literal

from mabirds_msgs.msg import LearnerStatus

from mabirds_core.consensus.schedule import EdgeSchedule
from mabirds_core.consensus.weights import Edge

EdgeState = Literal["delivered", "late", "missed", "closed", "unknown"]
"""Mixed in by its receiver; waited for; gone without; not open in this slot; its receiver is not heard."""


def edge_states(schedule: EdgeSchedule, statuses: Mapping[str, LearnerStatus | None]) -> dict[Edge, EdgeState]:
    """How each edge of a schedule stands, at the iteration in which its receiver is.

    Parameters
    ----------
    schedule : EdgeSchedule
        E(n).
    statuses : Mapping[str, LearnerStatus | None]
        The newest of each learner.

    Returns
    -------
    dict[Edge, EdgeState]
        By (sender, receiver), every edge that some slot opens.
    """
    return {edge: _state(schedule, edge, statuses.get(schedule.learners[edge[1]])) for edge in schedule.all_edges}


def _state(schedule: EdgeSchedule, edge: Edge, status: LearnerStatus | None) -> EdgeState:
    sender, receiver = edge
    if status is None:
        return "unknown"
    waits = [name for name in status.waiting_for if name in schedule.learners]
    name = schedule.learners[sender]
    iteration = slot_of(status, waits)
    if sender not in schedule.in_neighbours(receiver, iteration):
        return "closed"
    if waits:
        return "late" if name in waits else "delivered"
    if status.iteration <= 1:
        return "unknown"
    return "delivered" if name in status.mixed_from else "missed"


def slot_of(status: LearnerStatus, waits: list[str]) -> int:
    """The iteration whose edges count: that which is waited for, else that of the newest update.

    Parameters
    ----------
    status : LearnerStatus
        Of the receiver.
    waits : list[str]
        Neighbours that it waits for.

    Returns
    -------
    int
        From 1 on.
    """
    return int(status.iteration) if waits else max(1, int(status.iteration) - 1)
