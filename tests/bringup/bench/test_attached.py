"""The bench of those who look at a network: ratios of rounds, and a process's own time."""

import importlib.util
import os
import time
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[3] / "benches" / "attached.py"


@pytest.fixture(scope="module")
def attached() -> ModuleType:
    specification = importlib.util.spec_from_file_location("attached", SCRIPT)
    assert specification
    assert specification.loader
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    return module


@pytest.mark.parametrize(("load", "busy"), [(0.1, False), (3.0, True)])
def test_ratios_are_of_rounds_and_a_busy_machine_is_told(
    attached: ModuleType, capsys: pytest.CaptureFixture[str], load: float, busy: bool
) -> None:
    """The second round met a machine half as fast, which no ratio shows."""
    alone = [attached.Measured(rate, 1e3 / rate, 1.0) for rate in (200.0, 100.0, 200.0)]
    beside = [attached.Measured(rate, 1e3 / rate, 1.0) for rate in (180.0, 90.0, 20.0)]
    content = attached.summary({False: alone, True: beside}, load)
    (target,) = content["targets"]
    assert (target["value"], target["met"]) == (pytest.approx(0.9), True)
    assert content["rate_by_processor_time"] == pytest.approx(0.9)
    assert content["machine"]["load_before"] == load
    assert len(content["results"]) == 6
    assert ("other work runs here" in capsys.readouterr().err) is busy


def test_everybody_who_may_be_attached_has_a_command(attached: ModuleType, tmp_path: Path) -> None:
    commands = attached.attachments(tmp_path / "experiment.yaml", tmp_path)
    assert tuple(commands) == attached.WHO


def test_processor_time_is_that_of_a_process(attached: ModuleType) -> None:
    before = attached.processor_seconds(os.getpid())
    deadline = time.process_time() + 0.2
    while time.process_time() < deadline:
        pass
    assert 0.15 <= attached.processor_seconds(os.getpid()) - before < 5.0
