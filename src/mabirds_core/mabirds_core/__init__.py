"""MA-BIRDS without ROS: games, policies, Algorithm 1, mixing, schedules, metrics, the in-process network.

MA-BIRDS, multi-agent behavior inference from distributed and streaming demonstrations, is the algorithm of Liu and
Zhu (NeurIPS 2023). ``docs/equations.md`` maps the paper's equations to functions.
"""

from importlib.metadata import version

__version__ = version("mabirds_core")
