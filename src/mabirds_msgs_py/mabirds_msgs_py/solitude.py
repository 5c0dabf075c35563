"""A process that hears nobody says so: it may be in another ROS domain, or on a host whose link is down."""

import os
import time
from collections.abc import Callable


def nobody_heard(whom: str) -> str:
    """In words, what to look at.

    Parameters
    ----------
    whom : str
        Who is missing.

    Returns
    -------
    str
        With the ROS domain of this process.
    """
    return (
        f"nobody heard in ROS domain {os.environ.get('ROS_DOMAIN_ID') or '0'}, neither {whom}; compare ROS_DOMAIN_ID,"
        " ROS_AUTOMATIC_DISCOVERY_RANGE and the network link here and there"
    )


class Solitude:
    """For how long nobody has been there.

    Parameters
    ----------
    patience : float
        Seconds without anybody that are nothing to speak of.
    clock : Callable[[], float], optional
        Seconds that only grow.
    """

    def __init__(self, patience: float, clock: Callable[[], float] = time.monotonic) -> None:
        self._patience, self._clock, self._since, self._told = patience, clock, clock(), False

    def lasts(self, *, anybody: bool) -> bool:
        """Has nobody been there for longer than that?

        Parameters
        ----------
        anybody : bool
            Is somebody there now?

        Returns
        -------
        bool
            At every look as long as it lasts.
        """
        if anybody:
            self._since, self._told = self._clock(), False
        return self._clock() - self._since > self._patience

    def begins(self, *, anybody: bool) -> bool:
        """Is this the first look at which ``lasts`` holds?

        Parameters
        ----------
        anybody : bool
            Is somebody there now?

        Returns
        -------
        bool
            Once, until somebody has been there again.
        """
        news = self.lasts(anybody=anybody) and not self._told
        self._told = self._told or news
        return news
