"""The examples in the docstrings of mabirds_core run and show what they say."""

import doctest
import importlib
import pkgutil

import pytest

import mabirds_core

MODULES = sorted(module.name for module in pkgutil.walk_packages(mabirds_core.__path__, "mabirds_core."))


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_hold(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_examples_are_found() -> None:
    """Else the test above would pass for want of examples."""
    attempted = [doctest.testmod(importlib.import_module(name)).attempted for name in MODULES]
    assert "mabirds_core.games.patrol.game" in MODULES
    assert sum(attempted) >= 3
