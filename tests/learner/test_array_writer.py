"""Arrays are written as safetensors writes them, also where names, types and shapes change."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import array_shapes, arrays
from safetensors.numpy import load, save

from mabirds_core.arrays import Array
from mabirds_learner.array_writer import ArrayWriter

KINDS = st.sampled_from([np.float64, np.int64, np.uint8, np.bool_])
ARRAYS = KINDS.flatmap(lambda kind: arrays(kind, array_shapes(min_dims=1, max_dims=3, min_side=0, max_side=4)))
NAMES = st.sampled_from(["theta", "omega", "steps.squares", "observed.cost", "bag"])
NAMED = st.dictionaries(NAMES, ARRAYS, max_size=5)


@given(st.lists(NAMED, max_size=4))
def test_it_writes_what_safetensors_writes(several: list[dict[str, Array]]) -> None:
    writer = ArrayWriter()
    for named in several:
        assert writer.write(named) == save(named)


def test_other_values_of_the_same_shapes_are_not_those_of_before() -> None:
    writer = ArrayWriter()
    for value in (1.0, 2.0):
        found = load(writer.write({"theta": np.full(3, value), "omega": np.full((2, 2), -value)[:, ::2]}))
        assert found["theta"].tolist() == [value] * 3
        assert found["omega"].tolist() == [[-value], [-value]]
