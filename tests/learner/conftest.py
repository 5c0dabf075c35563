"""Four learners on a ring that mix by push-sum, for several test files."""

from collections.abc import Callable
from pathlib import Path

import pytest
from sessions import Streams, demonstrations

from mabirds_core.experiment.file import Experiment, load_experiment


@pytest.fixture
def ring(make_experiment: Callable[..., Path]) -> Experiment:
    """Four learners on a ring."""
    schedule = {"kind": "static", "graph": "ring"}
    change = {"mixing": {"kind": "resilient"}}
    return load_experiment(make_experiment(learners=4, iterations=20, schedule=schedule, change=change))


@pytest.fixture
def streams(ring: Experiment) -> Streams:
    """What the learners of the ring are to see."""
    return demonstrations(ring)
