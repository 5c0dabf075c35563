"""How far trajectories are from the places that were shown: average and final displacement errors."""

import numpy as np

from mabirds_core.arrays import Array, Mask


def displacements(shown: Array, flown: Array, under_way: Mask, count: int) -> tuple[Array, Array]:
    """Distances of trajectories to demonstrations, from the second step on until the expert shown has arrived.

    Parameters
    ----------
    shown : Array
        Places of m demonstrations, shape (m, T + 1, N_E, 2) [m].
    flown : Array
        Of ``count`` trajectories from each start, those of the first start first, shape (m k, T + 1, N_E, 2) [m].
    under_way : Mask
        Which experts of the demonstrations have not arrived, shape (m, T + 1, N_E).
    count : int
        k.

    Returns
    -------
    tuple[Array, Array]
        Mean over experts and these steps, and mean over experts at the last of them; shape (m, k) each [m].
    """
    away = np.sqrt(((flown - np.repeat(shown, count, axis=0)) ** 2).sum(axis=-1))
    until_arrival = np.concatenate([np.zeros_like(under_way[:, :1]), under_way[:, :-1]], axis=1)
    counted = np.repeat(until_arrival, count, axis=0)
    last = counted.shape[1] - 1 - counted[:, ::-1].argmax(axis=1)
    average = (away * counted).sum(axis=(1, 2)) / np.maximum(1, counted.sum(axis=(1, 2)))
    final = np.take_along_axis(away, last[:, None], axis=1)[:, 0].mean(axis=1)
    return average.reshape(-1, count), final.reshape(-1, count)
