"""exp, log and what is made of them for the learning path: the same bits on every processor (``kernels/fixed.h``).

numpy's exp, log, tanh and powers round differently on processors with and without AVX-512, and so do matrix products
of OpenBLAS. Additions, multiplications, divisions and square roots are the same everywhere; numpy adds up along an axis
in an order of its own, but one that no processor changes. Without compiled kernels numpy's functions have to do.
"""

import ctypes
from collections.abc import Callable
from functools import cache, lru_cache
from pathlib import Path

import numpy as np

from mabirds_core.arrays import Array, Vector
from mabirds_core.kernels.loading import library, pointer

FIXED = "fixed"
"""Name of the arithmetic of the kernels. Raised to "fixed2" where their bits change."""

_TERMS = 20
"""Of the series of exp(y) - 1: the next is below 1e-17 of the sum for |y| <= 1."""


def exp(x: Array) -> Array:
    """e^x, of the shape of ``x``; 0 below -708."""
    return _applied("mabirds_exp", np.exp, x)


def log(x: Array) -> Array:
    """Natural logarithms, of the shape of ``x``; -inf at 0."""
    return _applied("mabirds_log", np.log, x)


def tanh(x: Array) -> Array:
    """tanh(x) = (e^2x - 1) / (e^2x + 1), of the shape of ``x``."""
    doubled = 2.0 * np.minimum(np.abs(x), 20.0)
    series = np.zeros_like(doubled)
    for term in range(_TERMS, 0, -1):
        series = np.minimum(doubled, 1.0) / term * (1.0 + series)
    less_one = np.where(doubled < 1.0, series, exp(doubled) - 1.0)
    return np.asarray(np.copysign(less_one / (less_one + 2.0), x))


def power(base: float, exponent: float) -> float:
    """Powers of positive numbers.

    Parameters
    ----------
    base : float
        Above 0.
    exponent : float
        Any number.

    Returns
    -------
    float
        exp(exponent log base), within some 1e-15 of it.
    """
    return float(exp(exponent * log(np.array([base])))[0])


@lru_cache(maxsize=16)
def powers(base: float, count: int) -> Vector:
    """1, base, base^2, ..., multiplied one after the other; kept, and so not to be written to.

    Parameters
    ----------
    base : float
        Of the powers.
    count : int
        How many.

    Returns
    -------
    Vector
        Shape (count,).

    Examples
    --------
    >>> powers(0.5, 4).tolist()
    [1.0, 0.5, 0.25, 0.125]
    """
    factors = np.full(count, base, dtype=np.float64)
    factors[:1] = 1.0
    multiplied: Vector = np.multiply.accumulate(factors)
    multiplied.flags.writeable = False
    return multiplied


def product(a: Array, b: Array) -> Array:
    """Matrix product without BLAS, for small matrices.

    Parameters
    ----------
    a : Array
        Shape (I, K).
    b : Array
        Shape (K, J).

    Returns
    -------
    Array
        sum_k a[i, k] b[k, j], shape (I, J).
    """
    return np.asarray((a.T[:, :, None] * b[:, None, :]).sum(axis=0))


@cache
def arithmetic() -> str:
    """The name of this process's arithmetic; processes of one name agree in every bit.

    Returns
    -------
    str
        FIXED, or numpy with what its rounding depends on: its version, the processor and the kernel of OpenBLAS.
    """
    if library() is not None:
        return FIXED
    features = np._core._multiarray_umath.__cpu_features__  # type: ignore[attr-defined]  # noqa: SLF001 - nowhere else
    level = next((name for name in ("AVX512_SKX", "AVX2", "SSE42") if features.get(name)), "other")
    return f"numpy_{np.__version__}_{level}_{_blas_kernel()}".lower()


def _blas_kernel() -> str:
    """Which kernel the OpenBLAS in numpy's wheel takes on this processor; other builds of numpy are "other"."""
    for file in Path(np.__file__).parents[1].glob("numpy.libs/libscipy_openblas64_*"):
        name = ctypes.CDLL(str(file)).scipy_openblas_get_corename64_
        name.restype = ctypes.c_char_p
        return str(name().decode())
    return "other"


def _applied(kernel: str, fallback: Callable[[Array], Array], x: Array) -> Array:
    kernels = library()
    if kernels is None:
        with np.errstate(divide="ignore"):  # log 0 = -inf is meant
            return fallback(x)
    values = np.ascontiguousarray(x, dtype=np.float64)
    result = np.empty(values.shape)
    getattr(kernels, kernel)(pointer(values), pointer(result), ctypes.c_int64(values.size))
    return result.reshape(np.shape(x))
