"""Fixtures for all tests: small experiments with their bags, and ROS contexts in domains of their own."""

import itertools
import os
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from rclpy.context import Context

from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_expert_player.recorder import record
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.environment import prepare_environment

os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"  # tests do not hear other hosts, nor they the tests
prepare_environment()

REPOSITORY = Path(__file__).resolve().parents[1]
PATROL = REPOSITORY / "ros_ws" / "config" / "patrol.yaml"

# Domains 1 to 101 are safe on Linux. Tests of several processes at once have other ones, or start at different places.
FIRST_DOMAIN, LAST_DOMAIN = map(int, os.environ.get("MABIRDS_TEST_DOMAINS", "1-101").split("-"))
WORKER = int(os.environ.get("PYTEST_XDIST_WORKER", "gw0").removeprefix("gw"))
DOMAINS = range(FIRST_DOMAIN + WORKER, LAST_DOMAIN + 1, int(os.environ.get("PYTEST_XDIST_WORKER_COUNT", "1")))
_domains = (DOMAINS[(os.getpid() + number) % len(DOMAINS)] for number in itertools.count())

MakeExperiment = Callable[..., Path]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """The longest files first, and the quick ones of core last: where two run at a time, neither waits for long."""
    items.sort(key=lambda item: ("core" in item.path.parts, "network" not in item.path.parts))


@pytest.fixture(autouse=True)
def ros_domain(monkeypatch: pytest.MonkeyPatch) -> int:
    """A ROS domain that no other test uses, for this process and its children."""
    domain = next(_domains)
    monkeypatch.setenv("ROS_DOMAIN_ID", str(domain))
    return domain


@pytest.fixture
def context(ros_domain: int) -> Iterator[Context]:
    """An initialised ROS context, shut down afterwards."""
    own = Context()
    rclpy.init(args=[], context=own, domain_id=ros_domain)
    yield own
    rclpy.try_shutdown(context=own)


def settings(learners: int = 2, iterations: int = 6, schedule: dict[str, Any] | None = None) -> dict[str, Any]:
    """The settings of a small patrol experiment: a 3x4 ring, two experts that swap corners."""
    return {
        "name": "small",
        "game": {
            "kind": "patrol",
            "map": "....\n.##.\n....",
            "starts": [[[0, 0], [2, 3]]],
            "goals": [[2, 3], [0, 0]],
            "horizon": 7,
        },
        "algorithm": {"steps": {"alpha": 8.0, "beta": 4.0}, "rollouts": 20},
        "learners": [f"learner_{number + 1}" for number in range(learners)],
        "schedule": schedule or {"kind": "static"},
        "demonstrations": {"bag": "bag", "per_learner": iterations, "period": 1.0},
        "iterations": iterations,
        "seed": 3,
        "constraint_threshold": 0.1,
    }


def write_experiment(
    directory: Path, change: dict[str, Any] | None = None, name: str = "experiment", **keywords: Any
) -> Path:
    """Write an experiment file and its bag; keywords of ``settings``, or ``change``: keys to set."""
    file = directory / name / "experiment.yaml"
    file.parent.mkdir()
    file.write_text(yaml.safe_dump({**settings(**keywords), **(change or {})}), encoding="utf-8")
    experiment = load_experiment(file)
    record(experiment, experiment.demonstrations.bag)
    return file


@pytest.fixture
def make_experiment(tmp_path: Path) -> MakeExperiment:
    """``write_experiment`` into the directory of a test."""
    return partial(write_experiment, tmp_path)


@pytest.fixture(scope="module")
def make_shared_experiment(tmp_path_factory: pytest.TempPathFactory) -> MakeExperiment:
    """``write_experiment`` for all tests of a module, which leave it as it is."""
    return partial(write_experiment, tmp_path_factory.mktemp("shared"))


@pytest.fixture(scope="module")
def shared_ros_domain() -> Iterator[int]:
    """A ROS domain for processes that all tests of a module look at."""
    with pytest.MonkeyPatch.context() as patch:
        domain = next(_domains)
        patch.setenv("ROS_DOMAIN_ID", str(domain))
        yield domain


CIRCLE = {"centre": [1.5, 1.5], "radius": 0.3}
DRONES: dict[str, Any] = {
    "game": {
        "kind": "drones",
        "arena": [3.0, 3.0],
        "obstacles": [CIRCLE],
        "drones": [
            {"start": [x, 0.4], "start_spread": 0.1, "goal_region": {"centre": [3 - x, 2.6], "radius": 0.3}}
            for x in (0.4, 2.6)
        ],
        "horizon": 20,  # in 18 steps, one of twenty-five attempts of the pilots was in time
    },
    "demonstrations": {"bag": "bag", "per_learner": 6, "period": 1.0, "experts": "pilots"},
}
"""An arena of 3 m that two drones cross."""

PLANNERS: dict[str, dict[str, Any]] = {
    "lattice": {"kind": "lattice", "spacing": 0.144, "temperature": 1.0},
    "soft_actor_critic": {
        "kind": "soft_actor_critic",
        "hidden": 16,
        "steps": 5,
        "first_steps": 8,
        "batch": 16,
        "capacity": 600,
        "rollouts": 4,
        "guide": "none",
    },
    "guided": {"kind": "soft_actor_critic", "temperature": 0.5},
}
"""Quick ones."""


def write_drone_experiment(
    make: MakeExperiment, planner: str = "lattice", algorithm: dict[str, Any] | None = None, **keywords: Any
) -> Path:
    """The same for drones. ``planner``: which of PLANNERS; ``algorithm``: other settings; keywords of ``settings``."""
    quick = {"steps": {"alpha": 2.0, "beta": 0.5}, "window": 2, "rollouts": 8, "policy": PLANNERS[planner]}
    return make(change={**DRONES, "algorithm": {**quick, **(algorithm or {})}}, **keywords)


@pytest.fixture
def make_drone_experiment(make_experiment: MakeExperiment) -> MakeExperiment:
    """``write_drone_experiment`` into the directory of a test."""
    return partial(write_drone_experiment, make_experiment)


@pytest.fixture(scope="module")
def make_shared_drone_experiment(make_shared_experiment: MakeExperiment) -> MakeExperiment:
    """``write_drone_experiment`` for all tests of a module, which leave it as it is."""
    return partial(write_drone_experiment, make_shared_experiment)


OpenBag = Callable[..., DemonstrationBag]


@pytest.fixture
def open_bag() -> Iterator[OpenBag]:
    """A function that opens an experiment's bag, or another one of the same experiment; closed at the end."""
    with ExitStack() as bags:

        def open_one(experiment: Experiment, directory: Path | None = None) -> DemonstrationBag:
            place = directory or experiment.demonstrations.bag
            return bags.enter_context(DemonstrationBag(place, build_game(experiment), experiment.learners))

        yield open_one


@pytest.fixture
def experiment(make_experiment: MakeExperiment) -> Experiment:
    """The small experiment, loaded."""
    return load_experiment(make_experiment())
