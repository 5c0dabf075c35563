"""The long steps of set-up show signs of life."""

import importlib.util
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "tools" / "setup_workspace.py"
SAYING = "import time\nfor word in ('one', 'two'):\n  print('Collecting', word, flush=True)\n  time.sleep(0.5)\n"


@pytest.fixture
def setup(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    specification = importlib.util.spec_from_file_location("setup_workspace", SCRIPT)
    assert specification
    assert specification.loader
    module = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(module)
    monkeypatch.setattr(module, "LOG", tmp_path / "setup.log")
    module.LOG.write_text("Collecting what an earlier step had\n")
    return module


def test_a_step_tells_what_its_command_is_at(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(setup, "LOOK", 0.05)
    monkeypatch.setattr(setup, "NEWS", 0.2)
    begun = setup.LOG.stat().st_size
    with setup.LOG.open("a") as log, subprocess.Popen([sys.executable, "-c", SAYING], stdout=log) as process:
        setup.show_progress(process, begun)
    assert process.returncode == 0
    told = capsys.readouterr().out
    assert "1 packages, Collecting one" in told
    assert "2 packages, Collecting two" in told
    assert "earlier" not in told
    assert told.count("s: ") <= 8


@pytest.mark.parametrize(
    ("log", "words"),
    [
        ("", "at work"),
        ("nonsense\n", "at work"),
        ("[3/40] Building C object\n", "[3/40] Building C object"),
        ("Collecting a\nDownloading a.whl\n", "1 packages, Downloading a.whl"),
    ],
)
def test_the_newest_words_of_a_log(setup: ModuleType, log: str, words: str) -> None:
    setup.LOG.write_text(log)
    assert setup.newest_words(0) == words
