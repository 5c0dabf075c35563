"""Which messages are kept: of which iterations, and what becomes of one that says something else than one before."""

from collections.abc import Mapping
from typing import Any

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import RefusedMessageError
from mabirds_core.games.interface import Trajectories

Content = Trajectories | Parameters


def check_iteration(iteration: int, current: int, kept: Mapping[int, Any], history: int, content: Content) -> None:
    """Check that a message is to be kept: its iteration is new and in [current, current + history).

    The first message of an iteration stays. A later one is a harmless ``duplicate`` where its content is the same to
    the last bit, and a ``conflict`` where it is not: then somebody else sends in the same name.

    Parameters
    ----------
    iteration : int
        Of the message.
    current : int
        n.
    kept : Mapping[int, Any]
        Contents by iteration.
    history : int
        How many iterations ahead are kept.
    content : Content
        Of the message.

    Raises
    ------
    RefusedMessageError
        It is not to be kept.
    """
    if iteration < current:
        raise RefusedMessageError("old_iteration", f"iteration {iteration}, expected {current} or later")
    if iteration in kept and _same(kept[iteration], content):
        raise RefusedMessageError("duplicate", f"iteration {iteration} has arrived before")
    if iteration in kept:
        raise RefusedMessageError(
            "conflict",
            f"iteration {iteration} has arrived before with other content, which is kept; who else sends it?",
        )
    if iteration >= current + history:
        raise RefusedMessageError("future_iteration", f"iteration {iteration}, expected less than {current + history}")


def _same(kept: Content, content: Content) -> bool:
    return all(ours.tobytes() == theirs.tobytes() for ours, theirs in zip(kept, content, strict=True))
