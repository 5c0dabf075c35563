"""Whether a learner belongs to the network that is played to, in words."""

from collections.abc import Iterator, Mapping

from mabirds_core.digest import arithmetic_differs
from mabirds_core.texts import truncate


def what_is_other(digests: Mapping[str, tuple[str, str]]) -> Iterator[str]:
    """What a learner has otherwise.

    Parameters
    ----------
    digests : Mapping[str, tuple[str, str]]
        By what they are of: the learner's and ours.

    Yields
    ------
    str
        In words, for each that differs.
    """
    for name, (theirs, ours) in digests.items():
        if theirs != ours:
            what = arithmetic_differs(theirs, ours)
            yield f"another {name}: {what or f'digest {truncate(theirs)}, here {ours}'}"
