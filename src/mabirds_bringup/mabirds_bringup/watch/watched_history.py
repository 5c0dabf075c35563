"""What was heard of the learners of a run, on disk: however long a run, who watches it needs no more memory."""

import tempfile
from collections.abc import Collection, Mapping
from itertools import count, takewhile
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.consensus.schedule import DeliveredEdges
from mabirds_core.experiment.simulate import History
from mabirds_learner.parameters_log import SUFFIX, ParametersLog, VectorLog

DIRECTORY = "parameters"
"""Where a run directory keeps it."""


class Coverage(NamedTuple):
    """How much of a run is known.

    Attributes
    ----------
    last : dict[str, int]
        The newest iteration of each learner; 0: none was heard of.
    missing : dict[str, list[str]]
        By learner the iterations that are not known, such as "72-443"; without those of which all are.
    """

    last: dict[str, int]
    missing: dict[str, list[str]]

    @property
    def complete(self) -> bool:
        """Is nothing missing?"""
        return not self.missing


class WatchedHistory:
    """theta(n), omega(n) of each learner, and whose parameters it mixed; to be closed, or used in a ``with`` statement.

    ``directory``: of the files; those that are there are gone on with. ``initial``: by name what each begins with.
    ``learners``: whose parameters can be mixed. ``digest``: of the run.
    """

    def __init__(
        self, directory: Path | None, initial: Mapping[str, Parameters], learners: Collection[str], digest: str
    ) -> None:
        self._temporary = tempfile.TemporaryDirectory(prefix="mabirds-") if directory is None else None
        place = Path(self._temporary.name) if self._temporary else directory
        assert place is not None  # noqa: S101 - for the type checker
        self._learners = tuple(learners)
        self.parameters = {
            name: ParametersLog(place / f"{name}{SUFFIX}", like, digest) for name, like in initial.items()
        }
        self._mixed = {
            name: VectorLog(place / f"{name}.mixed{SUFFIX}", len(self._learners), digest) for name in initial
        }

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Close the files, and remove those that nobody asked for."""
        for name, log in self.parameters.items():
            log.close()
            self._mixed[name].close()
        if self._temporary:
            self._temporary.cleanup()

    def note_mixed(self, name: str, iteration: int, senders: Collection[str]) -> None:
        """Note whose parameters ``name`` mixed at ``iteration``."""
        self._mixed[name][iteration] = np.array([float(learner in senders) for learner in self._learners])

    def knows_mixed(self, name: str, iteration: int) -> bool:
        """Is it known whose parameters ``name`` mixed at ``iteration``?"""
        return iteration in self._mixed[name]

    def delivered(self) -> DeliveredEdges:
        """Whose parameters each learner says it mixed, at the iterations of which all learners' statuses were heard."""
        heard = set.intersection(*(set(log) for log in self._mixed.values()))
        return {n: [self._senders(log[n]) for log in self._mixed.values()] for n in sorted(heard)}

    def _senders(self, mask: np.ndarray) -> list[str]:
        return [learner for learner, entered in zip(self._learners, mask, strict=True) if entered]

    def newest_common(self) -> int:
        """The newest iteration that is known of all; 0 where there is none."""
        newest = min(log.newest for log in self.parameters.values())
        known = (n for n in range(newest, 0, -1) if all(n in log for log in self.parameters.values()))
        return next(known, 0)

    def without_gap(self) -> History:
        """theta(n), omega(n) from n = 1 up to the newest without a gap."""
        return {name: [log[n] for n in takewhile(log.__contains__, count(1))] for name, log in self.parameters.items()}

    def coverage(self, last: int, names: Collection[str]) -> Coverage:
        """What is known of iterations 1 to ``last`` of those who are to have reached it."""
        gaps = {name: self.parameters[name].gaps(last) for name in names}
        missing = {name: spans(numbers) for name, numbers in gaps.items() if numbers}
        return Coverage({name: log.newest for name, log in self.parameters.items()}, missing)

    def take(self, history: History) -> None:
        """Keep all of a history."""
        for name, parameters in history.items():
            for n, values in enumerate(parameters, start=1):
                self.parameters[name][n] = values

    def fill_from(self, checkpoints: Path) -> None:
        """Take what was not heard from what learners of this host have written to their ``checkpoints``."""
        for name, log in self.parameters.items():
            file = checkpoints / name / f"parameters{SUFFIX}"
            if file.is_file() and log.gaps(log.newest + 1):
                self._fill(log, file)

    def _fill(self, log: ParametersLog, file: Path) -> None:
        theirs = log.beside(file)
        try:
            for n in theirs:
                if n not in log:
                    log[n] = theirs[n]
        finally:
            theirs.close()


def spans(numbers: list[int]) -> list[str]:
    """Numbers in order as few words.

    >>> spans([1, 2, 3, 7, 9, 10])
    ['1-3', '7', '9-10']
    """
    edges = [k for k in range(1, len(numbers)) if numbers[k] != numbers[k - 1] + 1]
    pieces = [numbers[a:b] for a, b in zip([0, *edges], [*edges, len(numbers)], strict=True)]
    return [f"{piece[0]}-{piece[-1]}" if len(piece) > 1 else str(piece[0]) for piece in pieces if piece]
