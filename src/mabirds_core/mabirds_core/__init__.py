"""MA-BIRDS without ROS: games, policies, Algorithm 1, mixing, schedules, metrics, the in-process network.

MA-BIRDS, multi-agent behavior inference from distributed and streaming demonstrations, is the algorithm of Liu and
Zhu (NeurIPS 2023). ``docs/equations.md`` maps the paper's equations to functions.
"""

from typing import Any


def __getattr__(name: str) -> Any:
    """``__version__``, of the installed package: looked up where somebody asks for it, since that takes time."""
    if name == "__version__":
        from importlib.metadata import version

        return version("mabirds_core")
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
