"""Demonstrations of one learner, copied out of a bag in whatever order it has them, to be read in order of iteration.

They lie in a temporary file: memory stays flat, and one costs the same wherever it stood in the bag.
"""

import os
import tempfile
from array import array
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray


class Place(NamedTuple):
    """Where a demonstration came from: number of the file, log time in nanoseconds since the epoch."""

    file: int
    time: int


class Spool:
    """Serialised demonstrations by iteration, in a temporary file. To be closed."""

    def __init__(self) -> None:
        self._storage, self._end = tempfile.TemporaryFile(), 0  # noqa: SIM115 - closed by close()
        self.iterations, self._offsets, self._times = array("Q"), array("Q"), array("Q")
        self._lengths, self._files = array("I"), array("I")

    def __len__(self) -> int:
        return len(self.iterations)

    def add(self, iteration: int, data: bytes, place: Place) -> None:
        """Append a demonstration.

        Parameters
        ----------
        iteration : int
            n.
        data : bytes
            The message.
        place : Place
            Where it stood.
        """
        self._offsets.append(self._end)
        self._end += self._storage.write(data)
        self.iterations.append(iteration)
        self._lengths.append(len(data))
        self._files.append(place.file)
        self._times.append(place.time)

    def data(self, index: int) -> bytes:
        """The message at an index, from 0 on."""
        return os.pread(self._storage.fileno(), self._lengths[index], self._offsets[index])

    def place(self, index: int) -> Place:
        """Where the message at an index stood."""
        return Place(self._files[index], self._times[index])

    def close(self) -> None:
        """Give the file back."""
        self._storage.close()

    def sort(self) -> None:
        """By iteration; of the same iteration the one that came first stays first."""
        self._storage.flush()
        if self.iterations:
            self._keep(np.argsort(np.frombuffer(self.iterations, dtype=np.uint64), kind="stable"))

    def drop(self, indices: list[int]) -> None:
        """Forget the messages at these indices."""
        self._keep(np.delete(np.arange(len(self)), indices))

    def _keep(self, order: NDArray[np.intp]) -> None:
        for name in ("iterations", "_offsets", "_times", "_lengths", "_files"):
            values = getattr(self, name)
            kept = array(values.typecode)
            kept.frombytes(np.frombuffer(values, dtype=values.typecode)[order].tobytes())
            setattr(self, name, kept)
