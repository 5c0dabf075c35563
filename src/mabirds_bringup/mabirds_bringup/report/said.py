"""What learners said of themselves while they learned, as the recording of a run has it."""

from collections import defaultdict
from collections.abc import Collection
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple

import numpy as np
from mabirds_msgs.msg import LearnerStatus
from rclpy.serialization import deserialize_message

from mabirds_learner.learner_session import DEMONSTRATION
from mabirds_msgs_py import topics
from mabirds_msgs_py.bag_files import bag_files
from mabirds_msgs_py.bag_pass import message_data, read_file
from mabirds_msgs_py.conversion import NANOSECONDS
from mabirds_msgs_py.errors import BagError
from mabirds_msgs_py.mcap_scan import Found, McapScan

SECONDS = "iteration_seconds"
"""A metric of every status."""

TIMES = (
    "learner",
    "updates",
    "an update, median [ms]",
    "19 of 20 within [ms]",
    "the longest [ms]",
    "longest wait for a neighbour [ms]",
)
"""Columns of ``timings``."""


Edge = tuple[int, str, str]
"""Iteration, sender and receiver."""


class Said(NamedTuple):
    """What statuses tell beside what is kept of a run otherwise.

    Attributes
    ----------
    waits : dict[Edge, float]
        Seconds for which a receiver that had its demonstration waited for a sender's parameters.
    seconds : dict[str, dict[int, float]]
        By learner and iteration, how long the update took.
    """

    waits: dict[Edge, float]
    seconds: dict[str, dict[int, float]]


NOTHING = Said({}, {})
"""Where nothing was recorded."""


class _Listener:
    """Takes statuses in the order in which they were sent."""

    def __init__(self, learners: Collection[str]) -> None:
        self.topics = {f"/{name}/{topics.STATUS}": name for name in learners}
        self.said, self._waiting = Said({}, defaultdict(dict)), defaultdict[str, dict[Edge, int]](dict)

    def take(self, found: Found, _: McapScan) -> None:
        """Take a message of ``topics``."""
        status, name = deserialize_message(message_data(found.data), LearnerStatus), self.topics[found.channel.topic]
        self._note_waits(name, status, found.time)
        metrics = dict(zip(status.metric_names, status.metric_values, strict=False))
        if SECONDS in metrics:
            self.said.seconds[name][status.iteration - 1] = metrics[SECONDS]

    def _note_waits(self, name: str, status: LearnerStatus, time: int) -> None:
        """Waits begin with the first status that tells of them, and end with the first that does not."""
        missing = set(status.waiting_for)
        now = set() if DEMONSTRATION in missing else {(int(status.iteration), sender, name) for sender in missing}
        waiting = self._waiting[name]
        for edge in waiting.keys() - now:
            self.said.waits[edge] = (time - waiting.pop(edge)) / NANOSECONDS
        for edge in now:
            waiting.setdefault(edge, time)


def said(directory: Path, learners: Collection[str]) -> Said:
    """Read the statuses of a run directory's bags, as far as these can be read.

    Parameters
    ----------
    directory : Path
        Of the run.
    learners : Collection[str]
        Or methods: who learned.

    Returns
    -------
    Said
        Empty where nothing was recorded.
    """
    listener = _Listener(learners)
    for bag in sorted(directory.glob("bag*")):
        with suppress(BagError):
            for file in bag_files(bag):
                read_file(file, listener.topics.__contains__, listener.take)
    return listener.said


def timings(of_run: Said) -> list[list[str]]:
    """A line for each learner, in milliseconds: its updates, and its longest wait for another learner.

    Parameters
    ----------
    of_run : Said
        By its learners.

    Returns
    -------
    list[list[str]]
        As of TIMES.
    """
    lines = []
    for name, seconds in sorted(of_run.seconds.items()):
        waits = [wait for (_, _, receiver), wait in of_run.waits.items() if receiver == name]
        times = [*np.quantile([*seconds.values()], [0.5, 0.95, 1.0]), max(waits, default=0.0)]
        lines.append([name, str(len(seconds)), *(f"{1e3 * time:.3g}" for time in times)])
    return lines
