"""Names for the kinds of arrays, and the one operation on them that numpy does not type well."""

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
