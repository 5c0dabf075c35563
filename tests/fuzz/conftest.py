"""Fixtures of the fuzz tests: true messages of a small network, and nodes in this process."""

import importlib.util
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from truth import Truth, truth_of

HERE = Path(__file__).parent


def _network_fixtures() -> Any:
    """The fixtures of the network's tests, which run nodes in this process."""
    spec = importlib.util.spec_from_file_location("network_fixtures", HERE.parent / "network" / "conftest.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


nodes = _network_fixtures().nodes


@pytest.fixture
def make_truth(make_experiment: Callable[..., Path]) -> Callable[..., Truth]:
    """A function that makes an experiment with its bag and reference; keywords as of ``make_experiment``."""
    return lambda **keywords: truth_of(make_experiment(**keywords))


@pytest.fixture
def truth(make_truth: Callable[..., Truth]) -> Truth:
    """Two learners, six iterations."""
    return make_truth()
