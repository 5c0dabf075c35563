"""Whether a run is whole, and what its result is the result of: written into summary.json, and checked afterwards."""

from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from mabirds_bringup.run.stored_run import StoredRun
from mabirds_bringup.watch.watched_history import WatchedHistory
from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.digest import arrays_digest
from mabirds_core.errors import CheckpointError
from mabirds_learner.checkpoint import CheckpointMetadata, newest_checkpoint

TO_BE_JUDGED = "to_be_judged"
"""In summary.json: how many policies nobody has judged yet."""


@dataclass(frozen=True)
class Certificate:
    """What is known of a run.

    ``missing``: in words; empty where the run is complete. ``last_iterations``: by learner the newest that is known.
    ``parameters_digest``: by learner of theta and omega of that iteration. ``bag_digest``: of the demonstrations; None
    on a host without them. ``departed``: learners without which a resilient network went on.
    """

    missing: list[str]
    last_iterations: dict[str, int]
    parameters_digest: dict[str, str]
    bag_digest: str | None
    departed: list[str]

    @property
    def content(self) -> dict[str, Any]:
        """As summary.json has it."""
        return {
            "complete": not self.missing,
            "missing": self.missing,
            "departed": self.departed,
            "last_iterations": self.last_iterations,
            "bag_digest": self.bag_digest,
            "parameters_digest": self.parameters_digest,
        }


def certify(run: StoredRun, kept: WatchedHistory, departed: Collection[str] = ()) -> Certificate:
    """Say what is known of a run; what was not heard is first taken from what learners of this host have written."""
    kept.fill_from(run.checkpoints)
    names = [name for name in run.names if name not in departed]
    last, gaps = kept.coverage(run.last, names)
    missing = [f"{name}: iterations {', '.join(pieces)} of {run.last} are not known" for name, pieces in gaps.items()]
    final = {name: kept.parameters[name][n] for name, n in last.items() if n}
    missing += [words for name in names for words in _differences(run, name, kept)]
    digests = {name: arrays_digest(parameters) for name, parameters in final.items()}
    return Certificate(missing, last, digests, run.bag_digest, sorted(departed))


def _differences(run: StoredRun, name: str, kept: WatchedHistory) -> Iterator[str]:
    """How the newest checkpoint of a learner of this host differs from what is known of it."""
    whose = CheckpointMetadata(name, run.digest, run.experiment.edge_schedule.digest)
    try:
        found = newest_checkpoint(run.checkpoints / name, whose)
    except CheckpointError as error:
        yield f"{name}: {error}"
        return
    if found is None:
        return
    iteration, arrays = found
    known, saved = kept.parameters[name], Parameters(arrays["theta"], arrays["omega"])
    if iteration not in known:
        known[iteration] = saved
    if iteration != known.newest:
        yield f"{name}: its checkpoint is of iteration {iteration}, the newest known is {known.newest}"
    elif arrays_digest(known[iteration]) != arrays_digest(saved):
        yield f"{name}: parameters of iteration {iteration} differ from those of its checkpoint"


def contradictions(written: Mapping[str, Any], found: Certificate) -> list[str]:
    """What a summary says and the files of its run do not."""
    differ = [
        f"summary.json has {name} {written.get(name)!r}, the files say {value!r}"
        for name, value in found.content.items()
        if name != "departed" and written.get(name) != value
    ]
    if left := written.get(TO_BE_JUDGED):
        differ.append(f"summary.json lacks {left} policies that were to be judged; `mabirds report` judges them")
    return differ
