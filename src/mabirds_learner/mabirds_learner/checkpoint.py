"""Checkpoints: one safetensors file per iteration, written so that a killed process leaves only whole ones behind.

A file holds the arrays of a session and says in its metadata whose they are. safetensors notices a file cut short;
a SHA-256 of the arrays notices any other damage. The files of the last iterations stay. The newest is where a restarted
learner goes on, and the two before are its reserve. Still older ones answer neighbours that missed something: they hold
theta and omega alone, for what a planner remembers may be megabytes.
"""

import fcntl
import hashlib
import os
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save

from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError

SUFFIX = ".safetensors"
UNFINISHED = ".unfinished"
LOCK = "lock"
FORMAT = "mabirds-checkpoint-1"

COMPLETE = 3
"""How many of the newest files keep everything."""

LASTING = ("theta", "omega")
"""What the older ones keep."""


@dataclass(frozen=True)
class CheckpointMetadata:
    """Whose checkpoints they are.

    Attributes
    ----------
    learner : str
        Its name.
    experiment_digest : str
        Of the run.
    schedule_digest : str
        Of E(n).
    """

    learner: str
    experiment_digest: str
    schedule_digest: str


Checkpoints = dict[int, dict[str, Array]]
"""Arrays by the iteration before whose update they were written."""


class CheckpointStore:
    """The checkpoints of one learner in a directory of its own.

    Parameters
    ----------
    directory : Path
        Is made where there is none.
    metadata : CheckpointMetadata
        Whose they are.
    keep : int
        How many iterations stay, the newest.

    Raises
    ------
    CheckpointError
        The directory cannot be written, or another process writes to it.
    """

    def __init__(self, directory: Path, metadata: CheckpointMetadata, keep: int) -> None:
        self.directory, self._whose, self._keep = directory, metadata, keep
        self.refused: list[str] = []
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(directory / LOCK, os.O_WRONLY | os.O_CREAT)  # held until the process ends, however
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            for file in directory.glob(f"*{UNFINISHED}"):
                file.unlink()
        except BlockingIOError:
            raise CheckpointError(
                f"{directory}: another process writes its checkpoints here; end the other {metadata.learner}, or name"
                " another directory"
            ) from None
        except OSError as error:
            raise self._unwritable(error) from None

    def close(self) -> None:
        """Let another process have the directory."""
        os.close(self._lock)

    def save(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        """Write one checkpoint, whole and on the disk when this returns.

        Parameters
        ----------
        iteration : int
            n.
        arrays : Mapping[str, Array]
            By name.

        Raises
        ------
        CheckpointError
            It cannot be written; nothing is changed.
        """
        try:
            self._write(iteration, arrays)
            self._trim(iteration - COMPLETE)
            self._file(iteration - self._keep).unlink(missing_ok=True)
        except OSError as error:
            raise self._unwritable(error) from None

    def _write(self, iteration: int, arrays: Mapping[str, Array]) -> None:
        contiguous = {name: np.ascontiguousarray(values) for name, values in arrays.items()}
        _write_durably(self._file(iteration), save(contiguous, _metadata(self._whose, iteration, contiguous)))

    def _trim(self, iteration: int) -> None:
        """Leave what lasts. A damaged file stays as it is: whoever loads it says so."""
        with suppress(CheckpointError):
            _, arrays = self._read(self._file(iteration))
            if arrays.keys() > set(LASTING):
                self._write(iteration, {name: arrays[name] for name in LASTING})

    def load(self) -> Checkpoints:
        """All sound checkpoints by iteration; ``refused`` then says what is wrong with the others.

        Raises
        ------
        CheckpointError
            There are files and none is sound: starting anew would overwrite them.
        """
        self.refused = []
        checkpoints = dict(sorted(self._sound()))
        if self.refused and not checkpoints:
            raise CheckpointError(
                f"{self.directory}: no checkpoint can be used ({self.refused[-1]}); name another directory, or delete"
                " this one to start anew"
            )
        return checkpoints

    def _sound(self) -> Iterator[tuple[int, dict[str, Array]]]:
        for file in sorted(self.directory.glob(f"*{SUFFIX}")):
            try:
                yield self._read(file)
            except CheckpointError as error:
                self.refused.append(str(error))

    def _read(self, file: Path) -> tuple[int, dict[str, Array]]:
        return read_checkpoint(file, self._whose)

    def _file(self, iteration: int) -> Path:
        return self.directory / f"{iteration:08}{SUFFIX}"

    def _unwritable(self, error: OSError) -> CheckpointError:
        return CheckpointError(
            f"{self.directory}: checkpoints cannot be written ({error.strerror}); make room, or name another directory"
        )


def read_checkpoint(file: Path, whose: CheckpointMetadata) -> tuple[int, dict[str, Array]]:
    """Read one file.

    Parameters
    ----------
    file : Path
        Of a checkpoint.
    whose : CheckpointMetadata
        Whose it must be.

    Returns
    -------
    tuple[int, dict[str, Array]]
        Its iteration, and its arrays by name.

    Raises
    ------
    CheckpointError
        It names the file and what is wrong with it.
    """
    try:
        with safe_open(file, framework="numpy") as content:
            metadata = content.metadata() or {}
            arrays = {name: content.get_tensor(name) for name in content.keys()}  # noqa: SIM118 - no mapping
    except (SafetensorError, OSError, ValueError, TypeError) as error:
        raise CheckpointError(f"{file.name}: is no whole checkpoint ({error})") from None
    iteration = int(file.stem) if file.stem.isdecimal() else 0
    for name, expected in _metadata(whose, iteration, arrays).items():
        if metadata.get(name) != expected:
            raise CheckpointError(f"{file.name}: {name} is {metadata.get(name)!r}, expected {expected!r}")
    return iteration, arrays


def newest_checkpoint(directory: Path, whose: CheckpointMetadata) -> tuple[int, dict[str, Array]] | None:
    """Read the newest checkpoint, without keeping its learner from writing others.

    Parameters
    ----------
    directory : Path
        Of the checkpoints.
    whose : CheckpointMetadata
        Whose they must be.

    Returns
    -------
    tuple[int, dict[str, Array]] or None
        Its iteration, and its arrays by name; None where there is no file.

    Raises
    ------
    CheckpointError
        As of ``read_checkpoint``.
    """
    files = sorted(directory.glob(f"*{SUFFIX}"))
    return read_checkpoint(files[-1], whose) if files else None


def _metadata(whose: CheckpointMetadata, iteration: int, arrays: Mapping[str, Array]) -> dict[str, str]:
    return {
        "format": FORMAT,
        "iteration": str(iteration),
        **asdict(whose),
        "sha256": _fingerprint(arrays),
    }


def _write_durably(file: Path, content: bytes) -> None:
    """The old content or the new, never something in between, even if the power fails."""
    unfinished = file.with_suffix(UNFINISHED)
    with unfinished.open("wb") as stream:
        stream.write(content)
        stream.flush()
        os.fsync(stream.fileno())
    unfinished.replace(file)
    directory = os.open(file.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)


def _fingerprint(arrays: Mapping[str, Array]) -> str:
    """SHA-256 of names, types, shapes and content."""
    total = hashlib.sha256()
    for name, values in sorted(arrays.items()):
        total.update(f"{name} {values.dtype.str} {values.shape} ".encode())
        total.update(np.ascontiguousarray(values).tobytes())
    return total.hexdigest()
