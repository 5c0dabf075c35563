"""Reading trajectories of enumerable games from messages and bags."""

import numpy as np

from mabirds_core.arrays import Array, Indices
from mabirds_core.errors import ImpossibleTrajectoryError


def whole_numbers(what: str, values: Array, shape: tuple[int, int], bounds: list[int]) -> Indices:
    """Read numbers of a message or bag as integers.

    Parameters
    ----------
    what : str
        Their name, for messages.
    values : Array
        As they came.
    shape : tuple[int, int]
        They must have.
    bounds : list[int]
        0 <= values[:, k] < bounds[k].

    Returns
    -------
    Indices
        Of this shape.

    Raises
    ------
    ImpossibleTrajectoryError
        They have another shape, or are not whole or out of bounds.
    """
    if values.shape != shape:
        raise ImpossibleTrajectoryError(f"{what}: shape {values.shape}, expected {shape}")
    fits = values == np.minimum(np.maximum(np.floor(values), 0), np.subtract(bounds, 1))  # which no NaN does
    if not fits.all():
        step, column = np.argwhere(~fits)[0]
        raise ImpossibleTrajectoryError(
            f"{what} at step {step}, column {column}: {values[step, column]}, expected a whole number from 0"
            f" to {bounds[column] - 1}"
        )
    return values.astype(np.int64)
