"""exp and log of the compiled kernels against long double arithmetic, and at the ends of their ranges."""

import ctypes

import numpy as np
import pytest

from mabirds_core.kernels.loading import library, pointer

LIBRARY = library()
pytestmark = pytest.mark.skipif(LIBRARY is None, reason="kernels are not compiled")


def applied(name: str, x: np.ndarray) -> np.ndarray:
    y = np.empty_like(x)
    getattr(LIBRARY, name)(pointer(x), pointer(y), ctypes.c_int64(len(x)))
    return y


def errors(values: np.ndarray, exact: np.ndarray) -> np.ndarray:
    """In units in the last place."""
    return np.asarray(np.abs(values - exact) / np.spacing(np.abs(exact.astype(np.float64))), dtype=np.float64)


@pytest.mark.parametrize("span", [1e-9, 1.0, 708.0])
def test_exp_is_within_a_unit_and_a_half(span: float) -> None:
    x = np.random.default_rng(1).uniform(-span, span, 100_000)
    assert errors(applied("mabirds_exp", x), np.exp(x.astype(np.longdouble))).max() <= 1.5


@pytest.mark.parametrize("span", [1e-9, 0.7, 700.0])
def test_log_is_within_a_unit_and_a_half(span: float) -> None:
    x = np.exp(np.random.default_rng(2).uniform(-span, span, 100_000))
    assert errors(applied("mabirds_log", x), np.log(x.astype(np.longdouble))).max() <= 1.5


def test_ends_of_the_range() -> None:
    x = np.array([0.0, -np.inf, np.inf, np.nan, -708.5, 709.5])
    assert np.array_equal(applied("mabirds_exp", x), [1.0, 0.0, np.inf, np.nan, 0.0, np.inf], equal_nan=True)
    x = np.array([1.0, 0.0, np.inf, np.nan, -1.0, 5e-324])
    assert np.array_equal(applied("mabirds_log", x), [0.0, -np.inf, np.inf, np.nan, np.nan, -np.inf], equal_nan=True)


def test_a_pointer_leads_to_the_first_entry_also_of_what_may_not_be_written_to() -> None:
    array = np.arange(6.0)
    for part in (array, array[2:], array[:0]):
        place = part.ctypes.data
        assert pointer(part).value == place
        part.flags.writeable = False
        assert pointer(part).value == place


@pytest.mark.parametrize("wrong", [np.zeros(3, dtype=np.float32), np.zeros((4, 4))[:, ::2]])
def test_a_pointer_is_of_what_the_kernel_takes(wrong: np.ndarray) -> None:
    with pytest.raises(ValueError, match="a kernel takes contiguous float64"):
        pointer(wrong)
