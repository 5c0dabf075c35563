"""The first seconds of a process, while modules are loaded: imports nothing that takes time."""

import gc
import os
import signal
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager

EXIT_BAD_INPUT, EXIT_INTERRUPTED = 2, 130

MIDDLEWARE = "RMW_IMPLEMENTATION"

PLUGINS, NONE = "PYDANTIC_DISABLE_PLUGINS", "__all__"
"""Plug-ins of pydantic watch models being checked; looking for them reads the files of all installed packages."""

INDEX = ("share", "ament_index", "resource_index", "rmw_typesupport")


@contextmanager
def loading() -> Iterator[None]:
    """End at once, with one line, on Ctrl-C: nothing has been started yet, and modules half loaded raise anything.

    A process without standard output is ended likewise, since files that it opens would take that place. Plug-ins of
    pydantic are not looked for unless the user has set PYDANTIC_DISABLE_PLUGINS, be it to nothing.
    """
    require_output()
    require_middleware(os.environ)
    os.environ.setdefault(PLUGINS, NONE)
    before = signal.getsignal(signal.SIGINT)
    if before is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _end)
    try:
        with without_collection():
            yield
    finally:
        if before is not signal.SIG_IGN:
            signal.signal(signal.SIGINT, before)


@contextmanager
def without_collection() -> Iterator[None]:
    """Let nobody look for garbage while what is made stays: a quarter of the time that modules take to load.

    Nor is it looked through later: it is taken for permanent, so that each collection has less to do.
    """
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.freeze()
            gc.enable()


def require_output() -> None:
    """End with one line where standard output or standard error is closed."""
    for descriptor, name in ((1, "output"), (2, "error")):
        try:
            os.fstat(descriptor)
        except OSError:
            _say(f"error: standard {name} is closed; send it to a file, or to /dev/null")
            sys.exit(EXIT_BAD_INPUT)


def require_middleware(environment: Mapping[str, str]) -> None:
    """End with one line where the chosen middleware is not installed: loading ROS would end the process."""
    given = environment.get(MIDDLEWARE, "")
    installed = sorted(_middlewares(environment))
    if given and installed and given not in installed:
        _say(
            f"error: {MIDDLEWARE} is {given!r}, installed here: {', '.join(installed)}; take one of them, or install it"
        )
        sys.exit(EXIT_BAD_INPUT)


def _middlewares(environment: Mapping[str, str]) -> set[str]:
    """Those of ROS's index, which is below each prefix."""
    prefixes = environment.get("AMENT_PREFIX_PATH") or sys.prefix
    places = (os.path.join(prefix, *INDEX) for prefix in prefixes.split(os.pathsep))  # noqa: PTH118 - quick to load
    found = {name for place in places if os.path.isdir(place) for name in os.listdir(place)}  # noqa: PTH112, PTH208
    return found - {"rmw_implementation"}


def _end(*_: object) -> None:
    _say("error: interrupted while loading; nothing was started")
    os._exit(EXIT_INTERRUPTED)


def _say(words: str) -> None:
    """To standard error, if there is one."""
    try:
        os.write(2, f"{words}\n".encode())
    except OSError:
        return
