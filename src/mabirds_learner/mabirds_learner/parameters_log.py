"""theta(n), omega(n) of all iterations on disk: a file per learner in which n decides the place.

Learners keep some hundred iterations in memory, and whoever watches them keeps none. Each record carries its iteration
and a checksum, so that one that was never written, or only in part, is seen to be missing. Records are not
synchronised to the disk: a killed process loses none, and what a power cut takes is in the checkpoints.
"""

import os
import zlib
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.errors import CheckpointError

SUFFIX = ".log"

HEADER = 256
"""Bytes at the beginning of a file, which say what it holds."""

FORMAT = "mabirds-log-1"

READ_AT_ONCE = 2**20
"""Bytes of a file that are looked through in one piece when it is opened."""

ITEM = 8
"""Bytes of a float64."""


class VectorLog(Mapping[int, Vector]):
    """Vectors of one size by iteration n = 1, 2, ...; to be closed.

    Parameters
    ----------
    file : Path
        Is made, with its directory, where there is none.
    size : int
        Of a vector.
    whose : str
        Digest of the run that the file must be of.

    Raises
    ------
    CheckpointError
        The file is of another run, or of vectors of another size.
    """

    def __init__(self, file: Path, size: int, whose: str) -> None:
        self.file, self._size = file, size
        self._record = (size + 2) * ITEM  # the iteration before, the checksum behind
        self._there = np.zeros(64, dtype=np.bool_)
        self._count = self.newest = 0
        file.parent.mkdir(parents=True, exist_ok=True)
        self._descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
        header = f"{FORMAT} {size} {whose}\n".encode().ljust(HEADER, b"\0")
        found = os.pread(self._descriptor, HEADER, 0)
        if len(found) < HEADER:
            os.pwrite(self._descriptor, header, 0)
        elif found != header:
            self.close()
            words = found.rstrip(b"\n\0").decode(errors="replace")
            raise CheckpointError(
                f"{file}: is {words!r}, expected {header.rstrip(bytes(1)).decode().strip()!r}; name another directory,"
                " or delete this file"
            )
        self._look_through()

    def _look_through(self) -> None:
        """Note which records are whole."""
        at_once = max(1, READ_AT_ONCE // self._record)
        first = 1
        while content := os.pread(self._descriptor, at_once * self._record, self._place(first)):
            for offset in range(0, len(content) // self._record * self._record, self._record):
                record = content[offset : offset + self._record]
                if _is_whole(record, n := first + offset // self._record):
                    self._note(n)
            first += at_once

    def _note(self, iteration: int) -> None:
        if iteration in self:
            return
        if iteration >= self._there.size:
            self._there = np.concatenate([self._there, np.zeros(iteration + self._there.size, dtype=np.bool_)])
        self._there[iteration] = True
        self._count += 1
        self.newest = max(self.newest, iteration)

    def _place(self, iteration: int) -> int:
        return HEADER + (iteration - 1) * self._record

    def __setitem__(self, iteration: int, values: Vector) -> None:
        record = np.concatenate([[float(iteration)], values, [0.0]])
        record[-1] = zlib.crc32(record[:-1].tobytes())
        try:
            os.pwrite(self._descriptor, record.tobytes(), self._place(iteration))
        except OSError as error:
            raise CheckpointError(f"{self.file}: cannot be written ({error.strerror}); make room") from None
        self._note(iteration)

    def __getitem__(self, iteration: int) -> Vector:
        if iteration not in self:
            raise KeyError(iteration)
        content = os.pread(self._descriptor, self._record, self._place(iteration))
        if not _is_whole(content, iteration):  # damaged while the file was open: as good as never written
            self._there[iteration] = False
            self._count -= 1
            raise KeyError(iteration)
        return np.frombuffer(content, dtype=np.float64)[1:-1].copy()

    def __contains__(self, iteration: object) -> bool:
        return isinstance(iteration, int) and 0 < iteration < self._there.size and bool(self._there[iteration])

    def __iter__(self) -> Iterator[int]:
        return iter(map(int, np.flatnonzero(self._there)))

    def __len__(self) -> int:
        return self._count

    def gaps(self, last: int) -> list[int]:
        """Iterations from 1 to ``last`` that are not there."""
        there = np.zeros(last + 1, dtype=np.bool_)
        known = self._there[: last + 1]
        there[: known.size] = known
        return [int(n) for n in np.flatnonzero(~there) if n > 0]

    def close(self) -> None:
        """Close the file; nothing can be read afterwards."""
        if self._descriptor >= 0:
            os.close(self._descriptor)
            self._descriptor = -1


class ParametersLog(Mapping[int, Parameters]):
    """theta(n), omega(n) of one learner by n; to be closed.

    Parameters
    ----------
    file : Path
        Is made, with its directory, where there is none.
    like : Parameters
        Parameters of the shapes that all must have.
    whose : str
        Digest of the run.

    Raises
    ------
    CheckpointError
        The file is of another run or other shapes.
    """

    def __init__(self, file: Path, like: Parameters, whose: str) -> None:
        self._like, self._whose = like, whose
        self._split = like.theta.size
        self._vectors = VectorLog(file, like.theta.size + like.omega.size, whose)

    def beside(self, file: Path) -> "ParametersLog":
        """Another file of the same run and shapes."""
        return ParametersLog(file, self._like, self._whose)

    @property
    def newest(self) -> int:
        """The largest n; 0 where there is none."""
        return self._vectors.newest

    def __setitem__(self, iteration: int, parameters: Parameters) -> None:
        self._vectors[iteration] = np.concatenate(parameters)

    def __getitem__(self, iteration: int) -> Parameters:
        values = self._vectors[iteration]
        return Parameters(values[: self._split], values[self._split :])

    def __contains__(self, iteration: object) -> bool:
        return iteration in self._vectors

    def __iter__(self) -> Iterator[int]:
        return iter(self._vectors)

    def __len__(self) -> int:
        return len(self._vectors)

    def gaps(self, last: int) -> list[int]:
        """Iterations from 1 to ``last`` that are not there."""
        return self._vectors.gaps(last)

    def close(self) -> None:
        """Close the file; nothing can be read afterwards."""
        self._vectors.close()


def _is_whole(record: bytes, iteration: int) -> bool:
    """Does a record hold this iteration, undamaged?"""
    if len(record) < 2 * ITEM:
        return False
    first, checksum = np.frombuffer(record[:ITEM])[0], np.frombuffer(record[-ITEM:])[0]
    return bool(first == iteration and checksum == zlib.crc32(record[:-ITEM]))
