"""What a learning node tells /diagnostics."""

from collections.abc import Mapping

from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticArray

from mabirds_learner.progress import Session
from mabirds_msgs_py.diagnostics import diagnostic_message

HARMLESS = {"old_iteration", "duplicate", "old_epoch"}
"""Reasons of drops that follow from asking again."""


def learning_diagnostic(
    name: str,
    session: Session,
    drops: Mapping[str, int],
    metrics: Mapping[str, float],
    stamp: Time,
    *,
    stalled: bool,
) -> DiagnosticArray:
    """Tell how learning stands.

    Parameters
    ----------
    name : str
        Of the node.
    session : Session
        With what it waits for.
    drops : Mapping[str, int]
        Messages that were not used, by reason.
    metrics : Mapping[str, float]
        By name.
    stamp : Time
        The present time.
    stalled : bool
        It waits at the same iteration as a period ago.

    Returns
    -------
    DiagnosticArray
        With a warning where neighbours keep it waiting, or something came that should not have come.
    """
    waiting_for = session.waiting_for()
    values = {
        "iteration": session.iteration,
        "lag": session.lag,
        "backlog": session.backlog,
        "waiting for": ", ".join(waiting_for),
        **metrics,
        **{f"dropped: {reason}": count for reason, count in drops.items()},
    }
    warning = _needs_attention(session, drops, stalled=stalled)
    sentence = _sentence(session, waiting_for, stalled=stalled)
    return diagnostic_message(name, "learning", sentence, values, stamp, warning=warning)


def _needs_attention(session: Session, drops: Mapping[str, int], *, stalled: bool) -> bool:
    """Where a neighbour keeps the node waiting, or where something was dropped that should not have come."""
    waits_for_neighbours = bool(session.waiting_for()) and not session.missing_demonstration
    suspicious = bool(set(drops) - HARMLESS)
    return (stalled and waits_for_neighbours) or suspicious


def _sentence(session: Session, waiting_for: list[str], *, stalled: bool) -> str:
    if session.finished:
        return "finished"
    if waiting_for:
        return f"iteration {session.iteration}: {'still ' if stalled else ''}waits for {', '.join(waiting_for)}"
    return f"iteration {session.iteration}: learning"
