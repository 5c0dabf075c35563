"""Read damaged files in a process that may not take much memory or time; one line of JSON for each.

usage: python limited.py EXPERIMENT PATH ...   a directory is read as a bag of the experiment, a file as an experiment
"""

import json
import resource
import sys
from pathlib import Path

from mabirds_core.errors import MabirdsError
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.environment import prepare_environment

MORE_MEMORY = 512 * 2**20
"""Bytes that reading may take beside the process itself."""

SECONDS = 100


def read(experiment: Experiment, path: Path) -> None:
    if path.is_file():
        load_experiment(path)
        return
    with DemonstrationBag(path, build_game(experiment), experiment.learners) as bag:
        for name in experiment.learners:
            list(bag.trajectories(name))


def main() -> None:
    prepare_environment()
    experiment = load_experiment(Path(sys.argv[1]))
    read(experiment, experiment.demonstrations.bag)  # loads what is loaded late
    pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
    most = pages * resource.getpagesize() + MORE_MEMORY
    resource.setrlimit(resource.RLIMIT_AS, (most, most))
    resource.setrlimit(resource.RLIMIT_CPU, (SECONDS, SECONDS))
    for path in sys.argv[2:]:
        try:
            read(experiment, Path(path))
            found = "read"
        except MabirdsError as error:
            found = f"refused: {error}"
        except Exception as error:  # noqa: BLE001 - what else it may be is what the test looks for
            found = f"{type(error).__name__}: {error}"
        sys.stdout.write(json.dumps({"path": path, "outcome": found}) + "\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main()
