"""Libraries that only some experiments need: where one is missing, the error says how to get it."""

from importlib.util import find_spec

from mabirds_core.errors import ExperimentError, MabirdsError


def require(library: str, purpose: str, extra: str, error: type[MabirdsError] = ExperimentError) -> None:
    """Raise ``error`` where ``library`` is not installed; ``extra``: what brings it, such as mabirds_core[report].

    Called before a library is imported, which may take its time.
    """
    if find_spec(library) is None:
        raise error(f"{purpose}: expected the library {library}, which is not installed; pip install '{extra}'")
