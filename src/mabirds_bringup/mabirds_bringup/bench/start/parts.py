"""What a learner's processor time until it is heard consists of: processes that go a step further each.

Each does what a learner does, as a learner does it, and then ends at once.
"""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from textwrap import indent

LOADING = "from mabirds_msgs_py.early import loading\nwith loading():\n{}\nimport os; os._exit(0)"
"""How a learner loads."""

STEPS: Mapping[str, str] = {
    "python": "pass",
    "rclpy": "import rclpy.executors, rclpy.node, mabirds_msgs.msg",
    "numpy": "import numpy",
    "pydantic": "from pydantic import BaseModel\nclass Model(BaseModel): kind: str\nimport importlib.metadata",
    "mabirds": "import mabirds_learner.learner_node",
    "experiment": "from pathlib import Path\n"
    "from mabirds_core.experiment.assembly import build_learner\n"
    "from mabirds_core.experiment.file import load_experiment\n"
    "build_learner(load_experiment(Path({file!r})), {learner!r})",
}
"""What each of the processes does beside what those before it do."""


def commands(file: Path, learner: str) -> dict[str, list[str]]:
    """The command lines of the processes.

    Parameters
    ----------
    file : Path
        Of the experiment.
    learner : str
        One of its learners.

    Returns
    -------
    dict[str, list[str]]
        By the step with which each ends.
    """
    statements = [step.format(file=str(file), learner=learner) for step in STEPS.values()]
    programs = (LOADING.format(indent("\n".join(statements[: n + 1]), "    ")) for n in range(len(statements)))
    return {name: [sys.executable, "-c", program] for name, program in zip(STEPS, programs, strict=True)}


@contextmanager
def bytecode_kept(directory: Path) -> Iterator[None]:
    """Let processes keep what they compile, as Python does; else each start would be the first.

    Parameters
    ----------
    directory : Path
        For it, where the environment says that none is written beside the sources.

    Yields
    ------
    None
        With the environment of this process as others are to have it.
    """
    if not os.environ.get("PYTHONDONTWRITEBYTECODE"):
        yield
        return
    before = dict(os.environ)
    del os.environ["PYTHONDONTWRITEBYTECODE"]
    os.environ["PYTHONPYCACHEPREFIX"] = str(directory)
    try:
        yield
    finally:
        os.environ.clear()
        os.environ.update(before)
