"""Which demonstrations a bag holds: a digest of their content, so that one bag is not taken for another."""

from collections.abc import Sequence
from itertools import islice

from mabirds_core.digest import demonstrations_digest
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.errors import BagError


def bag_digest(bag: DemonstrationBag, learners: Sequence[str], iterations: int) -> str:
    """Digest of the demonstrations that a run uses; neither times nor files are in it.

    Parameters
    ----------
    bag : DemonstrationBag
        Open.
    learners : Sequence[str]
        Whose demonstrations count.
    iterations : int
        How many of each.

    Returns
    -------
    str
        SHA-256, in hexadecimal.
    """
    return demonstrations_digest({name: islice(bag.trajectories(name), iterations) for name in learners})


def require_digest(bag: DemonstrationBag, learners: Sequence[str], iterations: int, expected: str) -> None:
    """Check that a bag is the one with which a run began.

    Parameters
    ----------
    bag : DemonstrationBag
        Open; it is closed where it is another one.
    learners : Sequence[str]
        Whose demonstrations count.
    iterations : int
        How many of each.
    expected : str
        Digest of what it must hold; empty: anything.

    Raises
    ------
    BagError
        It holds other demonstrations.
    """
    if expected and (found := bag_digest(bag, learners, iterations)) != expected:
        bag.close()
        raise BagError(
            f"the bag holds other demonstrations (digest {found}) than those with which this run began ({expected}):"
            " bring the first bag back, or start another run"
        )
