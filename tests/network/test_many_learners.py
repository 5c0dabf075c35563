"""Many learner processes on one machine: a few start at a time, all find each other and learn, and leave nothing."""

import importlib.util
from pathlib import Path
from types import ModuleType

import pytest

BENCH = Path(__file__).resolve().parents[2] / "benches" / "many_learners.py"


@pytest.fixture
def bench() -> ModuleType:
    spec = importlib.util.spec_from_file_location("many_learners", BENCH)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.parametrize("learners", [12, pytest.param(32, marks=pytest.mark.slow)])
def test_many_learners_complete_twenty_iterations(bench: ModuleType, tmp_path: Path, learners: int) -> None:
    found = bench.measure(learners, 20, tmp_path)
    print(found)  # noqa: T201 - what the documentation reports
    assert found["iterations"] == 20
    assert found["deaths"] == 0
    assert found["shared_memory_files_left"] == 0
    assert found["megabytes_a_process"] < 150
