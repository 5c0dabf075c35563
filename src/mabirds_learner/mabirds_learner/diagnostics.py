"""What a learning node tells /diagnostics: one status of key-value pairs, as rqt and Foxglove show them."""

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

from mabirds_learner.progress import Session

HARMLESS = {"old_iteration", "duplicate"}
"""Reasons of drops that follow from asking again."""


def diagnostic_message(
    name: str, session: Session, drops: Mapping[str, int], stamp: Time, *, stalled: bool
) -> DiagnosticArray:
    """The message of node ``name``; ``stalled``: it waits at the same iteration as a period ago."""
    waiting_for = session.waiting_for()
    values = {
        "iteration": session.iteration,
        "backlog": session.backlog,
        "waiting for": ", ".join(waiting_for),
        **{f"dropped: {reason}": count for reason, count in drops.items()},
    }
    status = DiagnosticStatus(
        level=_level(session, drops, stalled=stalled),
        name=f"{name}: learning",
        hardware_id=name,
        message=_sentence(session, waiting_for, stalled=stalled),
        values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
    )
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message


def _level(session: Session, drops: Mapping[str, int], *, stalled: bool) -> bytes:
    """A warning where a neighbour keeps the node waiting, or where something was dropped that should not have come."""
    waits_for_neighbours = bool(session.waiting_for()) and not session.missing_demonstration
    suspicious = bool(set(drops) - HARMLESS)
    return DiagnosticStatus.WARN if (stalled and waits_for_neighbours) or suspicious else DiagnosticStatus.OK


def _sentence(session: Session, waiting_for: list[str], *, stalled: bool) -> str:
    if session.finished:
        return "finished"
    if waiting_for:
        return f"iteration {session.iteration}: {'still ' if stalled else ''}waits for {', '.join(waiting_for)}"
    return f"iteration {session.iteration}: learning"
