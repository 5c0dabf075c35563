"""Where the compiled kernels are, if they were compiled."""

import ctypes
import importlib.util
import logging
import os
from functools import cache

import numpy as np

SWITCH = "MABIRDS_KERNELS"
"""Environment variable; "off": do without compiled kernels."""

_KEPT = 2**26
"""Bytes that are kept, at most."""
_M_TRIM_THRESHOLD, _M_MMAP_THRESHOLD = -1, -3
"""From glibc's malloc.h."""


@cache
def library() -> ctypes.CDLL | None:
    """The compiled kernels, or None: numpy has to do, and the log says so once."""
    if os.environ.get(SWITCH) == "off":
        return None
    place = importlib.util.find_spec("mabirds_core.kernels.library")
    if place is None or place.origin is None:
        logging.getLogger(__name__).warning(
            "no compiled kernels: learning takes several times as long; install mabirds_core where there is gcc"
        )
        return None
    _keep_memory()
    return ctypes.CDLL(place.origin)


def _keep_memory() -> None:
    """Ask glibc to keep what one solve frees for the next: new pages of memory take as long as solving."""
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)
    if mallopt is not None:
        mallopt(_M_MMAP_THRESHOLD, _KEPT // 2)
        mallopt(_M_TRIM_THRESHOLD, _KEPT)


def pointer(array: np.ndarray, dtype: type = np.float64) -> ctypes.c_void_p:
    """Where an array lies; C sees neither shapes nor types, so they are checked here.

    Parameters
    ----------
    array : np.ndarray
        Contiguous.
    dtype : type, optional
        What the kernel takes.

    Returns
    -------
    ctypes.c_void_p
        Of its first entry; the array must live as long.

    Raises
    ------
    ValueError
        The array is of another type, or has gaps.
    """
    kind = array.dtype
    if kind.type is dtype and kind.isnative:
        try:  # the quick way, which refuses gaps
            return ctypes.c_void_p(ctypes.addressof(ctypes.c_char.from_buffer(array)))  # type: ignore[arg-type]  # numpy says it nowhere
        except (TypeError, ValueError):  # not to be written, or of no entries: no fault
            if array.flags.c_contiguous:
                return ctypes.c_void_p(array.__array_interface__["data"][0])
    raise ValueError(f"a kernel takes contiguous {np.dtype(dtype)}, found {array.dtype} {array.flags}")
