"""Libraries that only some experiments need: where one is missing, the error says how to get it."""

from importlib.util import find_spec

from mabirds_core.errors import ExperimentError, MabirdsError


def require(library: str, purpose: str, extra: str, error: type[MabirdsError] = ExperimentError) -> None:
    """Check that a library is installed, before it is imported, which may take its time.

    Parameters
    ----------
    library : str
        As it is imported.
    purpose : str
        What needs it.
    extra : str
        What brings it, such as mabirds_core[report].
    error : type[MabirdsError], optional
        What is raised where it is missing; an ``ExperimentError`` by default.

    Raises
    ------
    error
        It is not installed.
    """
    if find_spec(library) is None:
        raise error(f"{purpose}: expected the library {library}, which is not installed; pip install '{extra}'")
