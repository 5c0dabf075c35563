"""The experiments and launch files that come with the package, and the command that takes them."""

import subprocess
import sys
from pathlib import Path

import pytest
from ament_index_python.packages import PackageNotFoundError, get_package_share_directory

from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.environment import prepare_environment


def share() -> Path:
    """Where they are installed; an editable installation has them in ros_ws alone."""
    prepare_environment()
    try:
        return Path(get_package_share_directory("mabirds_bringup"))
    except PackageNotFoundError:
        return Path(__file__).resolve().parents[3] / "ros_ws"


def test_experiments_and_launch_files_are_there() -> None:
    assert {"patrol.yaml", "drones.yaml"} <= {file.name for file in (share() / "config").iterdir()}
    assert (share() / "launch" / "experiment.launch.py").is_file()


@pytest.mark.parametrize("name", ["patrol", "drones", "trio", "discrete", "discrete_many_starts", "hall"])
def test_every_experiment_that_is_installed_is_sound(name: str) -> None:
    assert load_experiment(share() / "config" / f"{name}.yaml").name == name


def test_the_command_takes_an_installed_experiment(tmp_path: Path) -> None:
    """From its file to demonstrations; the bag that it names lies beside the sources, not in share."""
    bag = tmp_path / "bag"
    arguments = ["record", str(share() / "config" / "patrol.yaml"), "--bag", str(bag)]
    program = "import sys; from mabirds_bringup.cli import main; main()"
    done = subprocess.run(
        [sys.executable, "-c", program, *arguments], capture_output=True, text=True, timeout=120, check=False
    )
    assert done.returncode == 0, done.stderr
    assert (bag / "metadata.yaml").is_file()
