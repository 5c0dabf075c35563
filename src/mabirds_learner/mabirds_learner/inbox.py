"""Which iteration a message may be of to be kept."""

from collections.abc import Container

from mabirds_msgs_py.conversion import RefusedMessageError


def accept(iteration: int, current: int, known: Container[int], history: int) -> None:
    """Raise RefusedMessageError unless ``iteration`` is new and in [current, current + history)."""
    if iteration < current:
        raise RefusedMessageError("old_iteration", f"iteration {iteration}, expected {current} or later")
    if iteration in known:
        raise RefusedMessageError("duplicate", f"iteration {iteration} has arrived before")
    if iteration >= current + history:
        raise RefusedMessageError("future_iteration", f"iteration {iteration}, expected less than {current + history}")
