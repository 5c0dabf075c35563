"""Checkpoints of any content: what was written comes back bit for bit, or is refused in words."""

from functools import partial
from pathlib import Path

import numpy as np
import pytest
from damage import examples, outcome

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError
from mabirds_learner.checkpoint import CheckpointMetadata, CheckpointStore, newest_checkpoint

OWNER = CheckpointMetadata("learner_1", "experiment", "schedule")
SOUND = {"theta": np.linspace(-3, 3, 40), "omega": np.linspace(0, -9, 30), "recent.0.states": np.ones((8, 4))}
LIKE = Parameters(SOUND["theta"], SOUND["omega"])
BYTES = pytest.mark.parametrize(
    ("seed", "count"), [(1, 150), *(pytest.param(seed, 3000, marks=pytest.mark.slow) for seed in range(2, 5))]
)


def write(directory: Path, *states: dict[str, Array]) -> bytes:
    store = CheckpointStore(directory, OWNER, LIKE, keep=4)
    for iteration, arrays in enumerate(states, start=7):
        store.save(iteration, arrays)
    store.close()
    return (directory / "journal").read_bytes().rstrip(b"\0") + bytes(200)


def bits(arrays: dict[str, Array]) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in arrays.items()}


@BYTES
def test_a_damaged_journal_is_refused_or_holds_what_is_whole(tmp_path: Path, seed: int, count: int) -> None:
    """A piece brought in from another journal may be all of it."""
    later = {name: values + 1 for name, values in SOUND.items()}
    other = {name: values + 2 for name, values in SOUND.items()}
    content, donor = write(tmp_path / "one", SOUND, later), write(tmp_path / "other", other, later)
    refusals, known = 0, [(7, bits(SOUND)), (8, bits(later)), (7, bits(other))]
    for example in examples(content, donor, seed, count):
        read = partial(newest_checkpoint, tmp_path / "one", OWNER)
        found = outcome(read, tmp_path / "one" / "journal", example, CheckpointError)
        if isinstance(found, CheckpointError):
            refusals += 1
            assert "no checkpoint can be used" in str(found), example.name
        else:
            iteration, arrays = found
            assert (iteration, bits(arrays)) in known, example.name
    assert 0 < refusals < count


@BYTES
def test_a_learner_goes_on_from_whatever_is_whole(tmp_path: Path, seed: int, count: int) -> None:
    later = {name: values + 1 for name, values in SOUND.items()}
    content, file = write(tmp_path / "one", SOUND, later), tmp_path / "one" / "journal"
    for example in examples(content, content, seed, count // 3):
        store = outcome(partial(CheckpointStore, file.parent, OWNER, LIKE, 4), file, example, CheckpointError)
        if isinstance(store, CheckpointStore):
            assert max(store.load()) in {7, 8}, example.name
            assert example.content == content or store.refused or max(store.load()) == 8, example.name
            store.save(9, SOUND)
            assert bits(store.load()[9]) == bits(SOUND), example.name
            store.close()
        else:
            assert "no checkpoint can be used" in str(store), example.name
