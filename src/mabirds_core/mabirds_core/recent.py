"""What was found of an object is kept as long as the object lives, for the newest few objects."""

import weakref
from collections import deque
from collections.abc import Callable
from typing import Any, Generic, TypeVar

V = TypeVar("V")


class Recent(Generic[V]):
    """Values of objects, which are told apart by identity; none is kept alive.

    Parameters
    ----------
    most : int
        Values that are kept.
    """

    def __init__(self, most: int) -> None:
        self._kept: deque[tuple[weakref.ref[Any], V]] = deque(maxlen=most)

    def get(self, of: Any, find: Callable[[], V]) -> V:
        """The value of an object.

        Parameters
        ----------
        of : Any
            The object, which must not change.
        find : Callable[[], V]
            Finds it out, the first time.

        Returns
        -------
        V
            The same each time.
        """
        for reference, value in self._kept:
            if reference() is of:
                return value
        value = find()
        self._kept.append((weakref.ref(of), value))
        return value
