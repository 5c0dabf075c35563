"""Names for the kinds of arrays, and the one operation on them that numpy does not type well."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Vector = NDArray[np.float64]
"""Shape (K,)."""
Array = NDArray[np.float64]
"""Any shape, stated where it is used."""
Indices = NDArray[np.int64]
"""Whole numbers that count states, actions, cells or learners."""
Mask = NDArray[np.bool_]
"""True or false by element."""


def weighted_counts(indices: NDArray[np.integer], weights: Array, size: int) -> Vector:
    """Sum of the weights at each index.

    Parameters
    ----------
    indices : NDArray[np.integer]
        From 0 to ``size`` - 1, of any shape.
    weights : Array
        Of the same shape.
    size : int
        How many sums there are.

    Returns
    -------
    Vector
        Shape (size,).

    Examples
    --------
    >>> weighted_counts(np.array([0, 2, 2]), np.array([1.0, 0.5, 0.25]), 3).tolist()
    [1.0, 0.0, 0.75]
    """
    return np.asarray(np.bincount(indices.ravel(), weights.ravel(), minlength=size), dtype=np.float64)


def digits(numbers: NDArray[np.integer], base: int, count: int) -> Indices:
    """Digits of numbers, the most significant first. (numpy 2.4's unravel_index errs on columns beyond 8192 rows.)

    Parameters
    ----------
    numbers : NDArray[np.integer]
        From 0 to ``base`` ** ``count`` - 1, of any shape.
    base : int
        Of the digits.
    count : int
        How many.

    Returns
    -------
    Indices
        Shape (count, *numbers.shape).

    Examples
    --------
    >>> digits(np.array([7, 2]), 3, 2).tolist()
    [[2, 0], [1, 2]]
    """
    found, rest = np.empty((count, *numbers.shape), dtype=np.int64), numbers
    for place in range(count - 1, 0, -1):
        higher = rest // base
        found[place] = rest - higher * base  # np.divmod takes thrice as long
        rest = higher
    found[0] = rest
    return found


def undigits(found: Sequence[NDArray[np.integer]] | NDArray[np.integer], base: int) -> Indices:
    """Inverse of ``digits``. (numpy's ravel_multi_index takes thrice as long for a few numbers.)

    Parameters
    ----------
    found : Sequence[NDArray[np.integer]] or NDArray[np.integer]
        Digits, the most significant first, of one shape.
    base : int
        Of the digits, each from 0 to ``base`` - 1.

    Returns
    -------
    Indices
        The numbers.

    Examples
    --------
    >>> undigits(np.array([[2, 0], [1, 2]]), 3).tolist()
    [7, 2]
    """
    numbers = np.array(found[0], dtype=np.int64)
    for digit in found[1:]:
        numbers *= base
        numbers += digit
    return numbers
