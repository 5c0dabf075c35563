"""Checkpoints of a learner: a journal of its newest states, and a log of theta and omega of all its iterations.

A state goes into the journal, and with it to the disk, before anybody hears of it; a record is the arrays of a session
as safetensors. Whoever restarts goes on from the newest; the two before are its reserve. Older ones leave the journal:
of them neighbours may ask for theta and omega, which are in the log. The log reaches the disk before the journal lets
go of what it holds.
"""

import fcntl
import os
from collections.abc import Mapping
from contextlib import AbstractContextManager, closing, suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from safetensors.numpy import load

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array, Vector
from mabirds_core.errors import CheckpointError
from mabirds_learner.array_writer import ArrayWriter
from mabirds_learner.journal import COMPLETE, Found, Journal, read_journal, synchronise_directory
from mabirds_learner.parameters_log import SUFFIX, ParametersLog, VectorLog
from mabirds_learner.records import HEADER, Buffer, Record, words_of

JOURNAL, PARAMETERS, LOCK = "journal", f"parameters{SUFFIX}", "lock"
"""Names of files in the directory of a learner."""

CONFIDENCES = f"confidences{SUFFIX}"
"""Name of the file of how sure a learner was of each constraint in the end."""

FORMAT = "mabirds-journal-1"

EARLIER = "*.safetensors"
"""Names of the files of versions that wrote one for each iteration."""

LASTING = ("theta", "omega")
"""What is kept of iterations that are no longer in the journal."""


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

    @property
    def words(self) -> str:
        """As the journal begins."""
        return "".join(f"{name} {value}\n" for name, value in {"format": FORMAT, **asdict(self)}.items())


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
    like : Parameters
        Parameters of the shapes that all must have.
    keep : int
        Of how many iterations a restarted learner is given theta and omega, the newest.

    Attributes
    ----------
    refused : list[str]
        What is wrong with those that cannot be used, in words.
    parameters : ParametersLog
        theta(n), omega(n) of all iterations.

    Raises
    ------
    CheckpointError
        The directory cannot be written, another process writes to it, or it is of an earlier version.
    """

    def __init__(self, directory: Path, metadata: CheckpointMetadata, like: Parameters, keep: int) -> None:
        self.directory, self._whose, self._keep, self._writer = directory, metadata, keep, ArrayWriter()
        self.refused: list[str] = []
        try:
            directory.mkdir(parents=True, exist_ok=True)
            self._lock = os.open(directory / LOCK, os.O_WRONLY | os.O_CREAT)  # held until the process ends, however
            fcntl.flock(self._lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            self._journal = Journal(directory / JOURNAL, metadata.words)
        except BlockingIOError:
            raise CheckpointError(
                f"{directory}: another process writes its checkpoints here; end the other {metadata.learner}, or name"
                " another directory"
            ) from None
        except OSError as error:
            raise self._unwritable(error) from None
        try:
            self.parameters: ParametersLog = self._open(like)
        except CheckpointError:
            os.close(self._lock)
            raise

    def _open(self, like: Parameters) -> ParametersLog:
        """Go on behind what is there; the log learns what a power cut took from it."""
        records = self._sound()
        log = ParametersLog(self.directory / PARAMETERS, like, self._whose.experiment_digest)
        self._journal.go_on_behind(records)
        for iteration, content in records:
            log[iteration] = _lasting(_read(content))
        return log

    def close(self) -> None:
        """Let another process have the directory."""
        self._journal.close()
        self.parameters.close()
        os.close(self._lock)

    def keep_confidences(self, iteration: int, confidences: Vector) -> None:
        """Write down how sure the learner is, so that who judges need not find it out again; lost if there is no room.

        Parameters
        ----------
        iteration : int
            n.
        confidences : Vector
            That each cost feature is a constraint, shape (K,).
        """
        with suppress(CheckpointError), self._confidences(len(confidences)) as log:
            log[iteration] = confidences

    def _confidences(self, size: int) -> AbstractContextManager[VectorLog]:
        return closing(VectorLog(self.directory / CONFIDENCES, size, self._whose.experiment_digest))

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
        content = self._writer.write(arrays)
        try:
            if not self._journal.has_room(len(content)):
                self.parameters.synchronise()
                synchronise_directory(self.directory)
            self._journal.append(iteration, content)
        except OSError as error:
            raise self._unwritable(error) from None
        self.parameters[iteration] = _lasting(arrays)

    def load(self) -> Checkpoints:
        """The newest states, and theta and omega of iterations before; ``refused`` then says what cannot be used."""
        states = {n: _read(content) for n, content in self._sound()[-COMPLETE:]}
        newest = max(states, default=0)
        lasting = {n: self.parameters[n]._asdict() for n in self.parameters if newest - self._keep < n < newest}
        kept = {**lasting, **states}
        return {n: kept[n] for n in sorted(kept) if n > newest - self._keep}

    def _sound(self) -> list[Record]:
        """Records to go on from, of the newest iterations, the oldest first."""
        records, self.refused = _sound_records(self.directory, self._whose)
        return records

    def _unwritable(self, error: OSError) -> CheckpointError:
        return CheckpointError(
            f"{self.directory}: checkpoints cannot be written ({error.strerror}); make room, or name another directory"
        )


def owner_of(directory: Path) -> CheckpointMetadata | None:
    """Whose a directory of checkpoints is, by what its journal says.

    Parameters
    ----------
    directory : Path
        Of the checkpoints.

    Returns
    -------
    CheckpointMetadata or None
        None where there is no journal, or one that does not say.
    """
    try:
        with (directory / JOURNAL).open("rb") as stream:
            said = _said(words_of(stream.read(HEADER)))
        return CheckpointMetadata(**{field.name: said[field.name] for field in fields(CheckpointMetadata)})
    except (OSError, KeyError):
        return None


def newest_of_anybody(directory: Path) -> tuple[int, dict[str, Array]] | None:
    """The newest checkpoint, whosever it is.

    Parameters
    ----------
    directory : Path
        Of the checkpoints.

    Returns
    -------
    tuple[int, dict[str, Array]] or None
        Its iteration, and its arrays by name; None where there is none.

    Raises
    ------
    CheckpointError
        None is sound.
    """
    owner = owner_of(directory)
    return newest_checkpoint(directory, owner) if owner else None


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
        Its iteration, and its arrays by name; None where there is none.

    Raises
    ------
    CheckpointError
        None is sound, or they are of an earlier version.
    """
    records, _ = _sound_records(directory, whose)
    return (records[-1].iteration, _read(records[-1].content)) if records else None


def _sound_records(directory: Path, whose: CheckpointMetadata) -> tuple[list[Record], list[str]]:
    """Records to go on from, and what is wrong with the others; raises CheckpointError where there are only such."""
    found = _found(directory, whose)
    if found is None:
        return [], []
    newest = {record.iteration: record for record in found.records}  # what was written again counts as it was last
    wrong = [*_strange(found.header, whose), *found.damaged]
    if not newest:
        raise _useless(directory, wrong[0] if wrong else "there is no record")
    return [newest[n] for n in sorted(newest)], [f"{JOURNAL}: {words}" for words in wrong]


def _found(directory: Path, whose: CheckpointMetadata) -> Found | None:
    try:
        return read_journal(directory / JOURNAL, whose.words)
    except FileNotFoundError:
        if earlier := sorted(directory.glob(EARLIER)):
            raise _useless(directory, f"{earlier[-1].name} is of an earlier version") from None
        return None
    except OSError as error:
        raise _useless(directory, f"{JOURNAL}: {error.strerror}") from None


def _useless(directory: Path, words: str) -> CheckpointError:
    return CheckpointError(
        f"{directory}: no checkpoint can be used ({words}); name another directory, or delete this one to start anew"
    )


def _strange(header: str, whose: CheckpointMetadata) -> list[str]:
    """In which words a header is not that of one's own journal."""
    expected, found = _said(whose.words), _said(header)
    return [
        f"{name} is {found.get(name)!r}, expected {value!r}"
        for name, value in expected.items()
        if found.get(name) != value
    ]


def _said(header: str) -> dict[str, str]:
    return {name: value for name, _, value in (line.partition(" ") for line in header.splitlines())}


def _read(content: Buffer) -> dict[str, Array]:
    arrays: dict[str, Array] = load(bytes(content))
    return arrays


def _lasting(arrays: Mapping[str, Array]) -> Parameters:
    return Parameters(*(arrays[name] for name in LASTING))
