"""Checkpoints of any content: what was written comes back bit for bit, or the file is refused by name."""

from pathlib import Path

import numpy as np
import pytest
from damage import examples, outcome

from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError
from mabirds_learner.checkpoint import CheckpointMetadata, CheckpointStore

OWNER = CheckpointMetadata("learner_1", "experiment", "schedule")
SOUND = {"theta": np.linspace(-3, 3, 40), "omega": np.linspace(0, -9, 30), "recent.0.states": np.ones((8, 4))}
BYTES = pytest.mark.parametrize(
    ("seed", "count"), [(1, 150), *(pytest.param(seed, 3000, marks=pytest.mark.slow) for seed in range(2, 5))]
)


def write(directory: Path, arrays: dict[str, Array]) -> bytes:
    store = CheckpointStore(directory, OWNER, keep=4)
    store.save(7, arrays)
    store.close()
    return (directory / "00000007.safetensors").read_bytes()


def bits(arrays: dict[str, Array]) -> dict[str, bytes]:
    return {name: values.tobytes() for name, values in arrays.items()}


@BYTES
def test_a_damaged_checkpoint_is_refused_or_whole(tmp_path: Path, seed: int, count: int) -> None:
    """A piece brought in from another checkpoint may be all of it."""
    other = {name: values + 1 for name, values in SOUND.items()}
    content, donor = write(tmp_path / "one", SOUND), write(tmp_path / "other", other)
    store, refusals = CheckpointStore(tmp_path / "one", OWNER, keep=4), 0
    for example in examples(content, donor, seed, count):
        found = outcome(store.load, tmp_path / "one" / "00000007.safetensors", example, CheckpointError)
        if isinstance(found, CheckpointError):
            refusals += 1
            assert "00000007.safetensors: " in str(found), example.name
        else:
            assert bits(found[7]) in (bits(SOUND), bits(other)), example.name
    assert refusals > count / 2
