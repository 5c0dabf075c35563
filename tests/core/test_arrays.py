"""Counting with weights, against a loop."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.arrays import digits, undigits, weighted_counts


@given(st.lists(st.tuples(st.integers(0, 5), st.floats(-1e6, 1e6))), st.integers(6, 9))
def test_weighted_counts_sum_the_weights_at_each_index(pairs: list[tuple[int, float]], size: int) -> None:
    expected = np.zeros(size)
    for index, weight in pairs:
        expected[index] += weight
    indices = np.array([index for index, _ in pairs], dtype=np.int64)
    weights = np.array([weight for _, weight in pairs])
    np.testing.assert_allclose(weighted_counts(indices, weights, size), expected, rtol=0, atol=1e-6)


def test_tables_are_counted_element_by_element() -> None:
    indices, weights = np.array([[0, 1], [1, 3]]), np.array([[1.0, 2.0], [4.0, 8.0]])
    assert weighted_counts(indices, weights, 5).tolist() == [1, 6, 0, 8, 0]


def test_counting_nothing_gives_zeros() -> None:
    assert weighted_counts(np.array([], dtype=np.int64), np.array([]), 3).tolist() == [0, 0, 0]


@given(st.integers(2, 30), st.integers(1, 4), st.integers(0, 10**6))
def test_digits_are_those_of_the_number(base: int, count: int, seed: int) -> None:
    numbers = np.random.default_rng(seed).integers(base**count, size=7)
    found = digits(numbers, base, count)
    assert [sum(int(d) * base ** (count - 1 - k) for k, d in enumerate(of_one)) for of_one in found.T] == list(numbers)
    assert found.min() >= 0
    assert found.max() < base
    assert undigits(found, base).tolist() == numbers.tolist()


def test_digits_of_a_long_column() -> None:
    """Where numpy's own function errs."""
    numbers = np.arange(30**3)
    np.testing.assert_array_equal(digits(numbers[:, None], 30, 3)[:, :, 0], digits(numbers, 30, 3))
