"""Memory for the tables of a policy, which goes from one policy to the next.

Tables of two drones take 200 MB. Where every policy asks the system for them, and gives them back, the system clears
all pages each time, for a fifth of the time of an iteration.
"""

import weakref

import numpy as np
from numpy.typing import NDArray

Codes = NDArray[np.uint16]

_spare: list[Codes] = []


class TableMemory:
    """An array that is as long as is asked for, or longer; whoever asks next gets it when nobody holds this any more.

    Parameters
    ----------
    codes : int
        How many numbers it is for.
    """

    def __init__(self, codes: int) -> None:
        array: Codes = _spare.pop() if _spare else np.empty(0, np.uint16)
        if len(array) < codes:
            del array  # before there is another one
            array = np.empty(codes + codes // 20, np.uint16)  # some lattices have a few nodes more
        self.array = array
        weakref.finalize(self, _spare.append, array).atexit = False
