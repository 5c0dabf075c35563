"""Digests: the same for the same content, whatever the order of keys; another for any other content."""

import hashlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.arithmetic import arithmetic
from mabirds_core.digest import arithmetic_differs, digest, experiment_digest, trajectory_digest

finite = st.floats(allow_nan=False, allow_infinity=False)
leaves = st.none() | st.booleans() | st.integers() | finite | st.text()


def test_a_digest_is_the_sha_256_of_canonical_json() -> None:
    assert digest({"b": [1, 0.5], "a": None}) == hashlib.sha256(b'{"a":null,"b":[1,0.5]}').hexdigest()


@given(st.dictionaries(st.text(), leaves | st.lists(leaves, max_size=3), max_size=6))
def test_a_digest_does_not_depend_on_the_order_of_keys(content: dict[str, object]) -> None:
    assert digest(dict(reversed(content.items()))) == digest(content)


@given(st.lists(st.integers()), st.lists(st.integers()))
def test_digests_differ_if_and_only_if_the_contents_do(one: list[int], other: list[int]) -> None:
    assert (digest(one) == digest(other)) == (one == other)


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_a_number_that_json_lacks_is_refused(value: float) -> None:
    with pytest.raises(ValueError, match="not JSON compliant"):
        digest({"x": value})


def test_an_experiments_digest_says_its_format_first() -> None:
    assert experiment_digest([1]) == f"v4-{arithmetic()}-{digest([1])}"


def test_hosts_whose_last_bits_may_differ_are_told_so_by_name() -> None:
    ours, theirs = (experiment_digest([1], name) for name in ("fixed", "numpy_2.4.6_avx2_haswell"))
    difference = arithmetic_differs(theirs, ours)
    assert difference is not None
    assert "arithmetic 'numpy_2.4.6_avx2_haswell', expected 'fixed'" in difference
    assert "compiled kernels" in difference


@pytest.mark.parametrize("given", ["other", "", "v4-fixed-abc", "v3-numpy-abc", "v4-numpy-abd", "v4-numpy-abc-d"])
def test_and_no_other_difference_is_called_one_of_arithmetic(given: str) -> None:
    assert arithmetic_differs(given, "v4-fixed-abc") is None


@pytest.mark.parametrize("features", [set(), {"AVX2"}, {"AVX2", "AVX512_SKX"}])
def test_without_kernels_the_arithmetic_is_numpys_on_this_processor(
    features: set[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("mabirds_core.arithmetic.library", lambda: None)
    monkeypatch.setattr(np._core._multiarray_umath, "__cpu_features__", dict.fromkeys(features, True))
    name = arithmetic.__wrapped__()
    level = "avx512_skx" if "AVX512_SKX" in features else "avx2" if features else "other"
    assert name.startswith(f"numpy_{np.__version__}_{level}_")
    assert "-" not in name


def test_what_decides_trajectories_is_in_their_digest() -> None:
    """Bags hold it: a recorded value, so that no change of code goes unnoticed."""
    content = b'{"dynamics":{"moves":4},"game":"patrol","horizon":7}'
    assert trajectory_digest("patrol", {"moves": 4}, 7) == f"v2-{hashlib.sha256(content).hexdigest()}"
