"""Demonstrations that are read before they are due, so that none is late because of the disk."""

from collections import deque

from mabirds_msgs.msg import Demonstration

from mabirds_msgs_py.bag_reader import DemonstrationBag

AT_ONCE = 8
"""Demonstrations that are read in one go, some 0.1 ms each."""


class ReadAhead:
    """Reads one learner's demonstrations in order.

    Parameters
    ----------
    bag : DemonstrationBag
        Of all learners.
    learner : str
        Whose demonstrations.
    depth : int
        How many are kept.
    """

    def __init__(self, bag: DemonstrationBag, learner: str, depth: int) -> None:
        self._bag, self._learner, self._depth = bag, learner, depth
        self._kept = deque[Demonstration]()

    def take(self, iteration: int) -> Demonstration:
        """A demonstration; those before it are forgotten, and all where it is not the next."""
        while self._kept:
            message = self._kept.popleft()
            if message.iteration == iteration:
                return message
        return self._bag.message(self._learner, iteration)

    def fill(self, sent: int, total: int) -> bool:
        """Read some that will be asked for next.

        Parameters
        ----------
        sent : int
            The newest one that was sent.
        total : int
            The last one that will be.

        Returns
        -------
        bool
            Whether there were any to read.
        """
        last = int(self._kept[-1].iteration) if self._kept else sent
        wanted = range(last + 1, min(total, last + AT_ONCE, sent + self._depth) + 1)
        self._kept.extend(self._bag.message(self._learner, iteration) for iteration in wanted)
        return len(wanted) > 0
