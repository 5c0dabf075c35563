"""Memory for the tables of a policy, which goes from one policy to the next.

Tables of two drones take 200 MB. Where every policy asks the system for them, and gives them back, the system clears
all pages each time, for a fifth of the time of an iteration.
"""

import weakref

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.uint16]

MOST_SPARE = 3
"""Arrays that wait for somebody to ask: as many as three drones have pairs."""

_spare: list[Codes] = []


class _Lease:
    """What arrays are views of: it is gone when nobody holds any of them any more."""

    def __init__(self, array: Codes) -> None:
        self.__array_interface__ = array.__array_interface__


def table_memory(codes: int) -> Codes:
    """An array for codes, which whoever asks later gets when nobody holds a part of it any more.

    Parameters
    ----------
    codes : int
        How many.

    Returns
    -------
    Codes
        That long, or longer, with any content.
    """
    fitting = [k for k, array in enumerate(_spare) if len(array) >= codes]
    if not fitting:
        _spare.clear()  # too small: given back before there is another one
    # Some lattices have a few nodes more than others.
    array = _spare.pop(fitting[0]) if fitting else np.empty(codes + codes // 20, np.uint16)
    lease = _Lease(array)
    weakref.finalize(lease, _keep, array).atexit = False
    return np.asarray(lease)


def _keep(array: Codes) -> None:
    if len(_spare) < MOST_SPARE:
        _spare.append(array)
