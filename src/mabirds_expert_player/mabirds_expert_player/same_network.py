"""Whether a learner belongs to the network that is played to, and what it says contradicts, in words."""

from collections.abc import Iterator

from mabirds_core.digest import arithmetic_differs
from mabirds_core.texts import truncate

Digests = tuple[str, str, str]
"""Of game, experiment and schedule."""


def what_is_other(learners: Digests, here: Digests) -> Iterator[str]:
    """What a learner has otherwise.

    Parameters
    ----------
    learners : Digests
        The learner's.
    here : Digests
        Ours.

    Yields
    ------
    str
        In words, for each that differs.
    """
    for name, theirs, ours in zip(("game", "experiment", "schedule"), learners, here, strict=True):
        if theirs != ours:
            what = arithmetic_differs(theirs, ours)
            yield f"another {name}: {what or f'digest {truncate(theirs)}, here {ours}'}"


def contradiction(learner: str, claimed: int, learned: int | None, *, second_player: bool) -> str:
    """Say that a learner cannot have learned so much.

    Parameters
    ----------
    learner : str
        Its name.
    claimed : int
        What it says.
    learned : int or None
        What is believed; None: nothing yet.
    second_player : bool
        Somebody else plays to it.

    Returns
    -------
    str
        With what may be the cause.
    """
    believed = "nothing yet" if learned is None else learned
    why = "It was started again, or somebody else speaks in its name"
    return (
        f"{learner} says that it learned {claimed}, which contradicts what was sent or said before; believed:"
        f" {believed}. {f'A second expert_player plays to {learner}; end all but one' if second_player else why}"
    )
