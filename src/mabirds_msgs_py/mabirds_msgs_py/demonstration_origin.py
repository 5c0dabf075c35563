"""To which network a demonstration is played, and from which bag: two words in one field of its message.

A field of its own would change the type, and with it every recorded bag.
"""

import re

from mabirds_msgs.msg import Demonstration

from mabirds_core.errors import RefusedMessageError
from mabirds_core.texts import truncate

DIGEST = re.compile("[0-9a-f]{64}")
"""SHA-256, in hexadecimal."""


def played_to(experiment_digest: str, bag_digest: str) -> str:
    """Which network demonstrations are played to, and from which bag.

    Parameters
    ----------
    experiment_digest : str
        Of the run.
    bag_digest : str
        Of what the player plays from; empty where it was told none.

    Returns
    -------
    str
        Experiment digest of ``Demonstration``: bags that are recorded from a network keep their form.
    """
    return f"{experiment_digest} {bag_digest}".rstrip()


def network_of(message: Demonstration) -> str:
    """To which network a demonstration is played.

    Parameters
    ----------
    message : Demonstration
        As it came.

    Returns
    -------
    str
        The digest of its experiment; empty where it is for any.
    """
    network: str = message.experiment_digest.partition(" ")[0]
    return network


def bag_of(message: Demonstration) -> str:
    """From which bag a demonstration was played.

    Parameters
    ----------
    message : Demonstration
        As it came.

    Returns
    -------
    str
        The digest of the bag; empty where the player does not say.

    Raises
    ------
    RefusedMessageError
        It is no digest.
    """
    bag: str = message.experiment_digest.partition(" ")[2]
    if bag and not DIGEST.fullmatch(bag):
        raise RefusedMessageError("wrong_experiment", f"bag digest {truncate(bag)!r}, expected 64 digits, 0 to f")
    return bag
