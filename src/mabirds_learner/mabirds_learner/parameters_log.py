"""theta(n), omega(n) of all iterations on disk: a file per learner in which n decides the place.

Learners keep some hundred iterations in memory, and whoever watches them keeps none. Each record carries its iteration
and a checksum (records.py), so that one that was never written, or only in part, is seen to be missing. Records are not
synchronised to the disk one by one: a killed process loses none, and what a power cut takes is in the checkpoints.
"""

import os
from collections.abc import Iterator, Mapping
from pathlib import Path

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Vector
from mabirds_core.errors import CheckpointError
from mabirds_learner.records import HEADER, Format, Record, words_of, write_all

SUFFIX = ".log"

FORMAT = "mabirds-log-2"

READ_AT_ONCE = 2**20
"""Bytes of a file that are looked through in one piece when it is opened."""


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
        self._format = Format(f"{FORMAT} {size} {whose}\n")
        self._record = Record(0, np.zeros(size).tobytes()).size
        self._there = np.zeros(64, dtype=np.bool_)
        self._count = self.newest = 0
        file.parent.mkdir(parents=True, exist_ok=True)
        self._descriptor = os.open(file, os.O_RDWR | os.O_CREAT, 0o644)
        self._require_header()
        self.look_again()

    def _require_header(self) -> None:
        found, expected = os.pread(self._descriptor, HEADER, 0), self._format.header
        if len(found) < HEADER:
            os.pwrite(self._descriptor, expected, 0)
        elif found != expected:
            self.close()
            raise CheckpointError(
                f"{self.file}: is {words_of(found)!r}, expected {words_of(expected)!r}; name another directory, or"
                " delete this file"
            )

    def look_again(self) -> None:
        """Note which records are whole, from the first that was not: another process may have written some."""
        at_once = max(1, READ_AT_ONCE // self._record)
        first = int(np.argmin(np.append(self._there[1:], False))) + 1
        while content := os.pread(self._descriptor, at_once * self._record, self._place(first)):
            for offset in range(0, len(content) // self._record * self._record, self._record):
                if self._found(content, n := first + offset // self._record, offset):
                    self._note(n)
            first += at_once

    def _found(self, content: bytes, iteration: int, offset: int = 0) -> Record | None:
        """The record of this iteration, if it is there and whole."""
        record = self._format.unpack(content, offset)
        fits = record is not None and (record.iteration, record.size) == (iteration, self._record)
        return record if fits else None

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
        try:
            write_all(
                self._descriptor,
                self._format.pack(iteration, np.asarray(values, np.float64).tobytes()),
                self._place(iteration),
            )
        except OSError as error:
            raise CheckpointError(f"{self.file}: cannot be written ({error.strerror}); make room") from None
        self._note(iteration)

    def __getitem__(self, iteration: int) -> Vector:
        if iteration not in self:
            raise KeyError(iteration)
        record = self._found(os.pread(self._descriptor, self._record, self._place(iteration)), iteration)
        if record is None:  # damaged while the file was open: as good as never written
            self._there[iteration] = False
            self._count -= 1
            raise KeyError(iteration)
        return np.frombuffer(record.content, dtype=np.float64).copy()

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

    def synchronise(self) -> None:
        """See to it that all is on the disk.

        Raises
        ------
        OSError
            It cannot be.
        """
        os.fdatasync(self._descriptor)

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

    def look_again(self) -> None:
        """Note what another process has written since."""
        self._vectors.look_again()

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

    def synchronise(self) -> None:
        """See to it that all is on the disk.

        Raises
        ------
        OSError
            It cannot be.
        """
        self._vectors.synchronise()

    def close(self) -> None:
        """Close the file; nothing can be read afterwards."""
        self._vectors.close()
