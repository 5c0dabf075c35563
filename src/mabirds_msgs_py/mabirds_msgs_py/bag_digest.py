"""Which demonstrations a bag holds: a digest of their content, so that one bag is not taken for another."""

from collections.abc import Sequence
from itertools import islice
from pathlib import Path

from mabirds_core.digest import demonstrations_digest
from mabirds_core.games.interface import ConstrainedMarkovGame
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


def open_bag(
    directory: Path, game: ConstrainedMarkovGame, learners: Sequence[str], iterations: int, expected: str
) -> DemonstrationBag:
    """Open the bag with which a run began.

    Parameters
    ----------
    directory : Path
        Of the bag.
    game : ConstrainedMarkovGame
        Of the demonstrations.
    learners : Sequence[str]
        Whose demonstrations count.
    iterations : int
        How many of each.
    expected : str
        Digest of what it must hold; empty: anything.

    Returns
    -------
    DemonstrationBag
        To be closed.

    Raises
    ------
    BagError
        It is damaged, or holds other demonstrations.
    """
    bag = DemonstrationBag(directory, game, learners, at_least=iterations)
    if expected and (found := bag_digest(bag, learners, iterations)) != expected:
        bag.close()
        raise BagError(
            f"{directory}: holds other demonstrations (digest {found}) than those with which this run began"
            f" ({expected}): bring the first bag back, or start another run"
        )
    return bag
