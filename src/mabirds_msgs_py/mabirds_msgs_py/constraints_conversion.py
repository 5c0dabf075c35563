"""What a learner takes for constraints, to messages and back."""

from collections.abc import Sequence

from mabirds_msgs.msg import Constraints

from mabirds_core.arrays import Vector
from mabirds_core.errors import RefusedMessageError
from mabirds_core.metrics.constraints import surest_first
from mabirds_core.texts import truncate


def constraints_message(names: Sequence[str], confidences: Vector, level: float) -> Constraints:
    """Write the constraints at a confidence, without sender and digest.

    Parameters
    ----------
    names : Sequence[str]
        Of all cost features, shape (K,).
    confidences : Vector
        That each is a constraint, shape (K,); negative for what demonstrations had.
    level : float
        Confidence from which on a feature is a constraint.

    Returns
    -------
    Constraints
        The surest first.
    """
    constraints = surest_first(names, confidences, level)
    return Constraints(
        level=level,
        undetermined=int(((confidences >= 0) & (confidences < level)).sum()),
        names=list(constraints),
        confidences=list(constraints.values()),
    )


def read_constraints(message: Constraints) -> dict[str, float]:
    """Names and confidences of any sender, for showing.

    Raises
    ------
    RefusedMessageError
        There are more of one than of the other, or a confidence is no probability of at least ``level``, or this none.
    """
    if len(message.names) != len(message.confidences):
        raise RefusedMessageError(
            "wrong_shape", f"confidences: {len(message.confidences)} numbers, expected {len(message.names)}"
        )
    if not 0 <= message.level <= 1:
        raise RefusedMessageError("impossible_constraints", f"level {message.level:g}, expected 0 to 1")
    for name, confidence in zip(message.names, message.confidences, strict=True):
        if not message.level <= confidence <= 1:
            raise RefusedMessageError(
                "impossible_constraints",
                f"confidence {confidence:g} of {truncate(name)!r}, expected {message.level:g} to 1",
            )
    return dict(zip(message.names, message.confidences, strict=True))


def constraints_text(message: Constraints, count: int) -> str:
    """The constraints in a line.

    Parameters
    ----------
    message : Constraints
        Of ``read_constraints``' kind.
    count : int
        How many of the surest are named.

    Returns
    -------
    str
        How many there are, and the surest with their confidences.
    """
    pairs = zip(message.names[:count], message.confidences[:count], strict=False)
    surest = ", ".join(f"{name} {confidence:.3f}" for name, confidence in pairs)
    counts = f"{len(message.names)} constraints at confidence {message.level:g}, {message.undetermined} undetermined"
    return f"{counts}; the surest: {surest}" if surest else counts
