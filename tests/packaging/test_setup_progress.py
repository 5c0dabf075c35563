"""The long steps of set-up show signs of life."""

import importlib.util
import re
import subprocess
import sys
import time
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
    monkeypatch.setattr(module, "VENV", tmp_path / "venv")
    module.LOG.write_text("Collecting what an earlier step had\n")
    return module


def test_a_step_tells_what_its_command_is_at(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(setup, "LOOK", 0.05)
    monkeypatch.setattr(setup, "NEWS", 0.2)
    begun = setup.LOG.stat().st_size
    monkeypatch.setitem(setup.BEGUN, 3, time.monotonic())
    with setup.LOG.open("a") as log, subprocess.Popen([sys.executable, "-c", SAYING], stdout=log) as process:
        setup.show_progress(process, begun)
    assert process.returncode == 0
    told = capsys.readouterr().out
    assert "1 packages, Collecting one" in told
    assert "2 packages, Collecting two" in told
    assert "earlier" not in told
    assert "0 s, about 4 min left: " in told
    assert told.count("left: ") <= 8


@pytest.mark.parametrize(
    ("number", "seconds", "words"),
    [
        (3, 20.0, "20 s, about 3 min left"),
        (4, 10.4, "10 s, about 60 s left"),
        (5, 14.0, "14 s, about 10 s left"),
        (4, 61.0, "61 s, longer than usual"),
    ],
)
def test_what_is_left_is_told_by_what_steps_usually_take(
    setup: ModuleType, monkeypatch: pytest.MonkeyPatch, number: int, seconds: float, words: str
) -> None:
    monkeypatch.setattr(setup, "USUAL", {1: 1.0, 2: 5.0, 3: 140.0, 4: 60.0, 5: 10.0 if number < 5 else 15.0})
    with setup.step(number, "working"):
        assert setup.progress_words(setup.BEGUN[number] + seconds) == words


def test_what_is_left_is_told_by_the_pace_once_there_is_one(setup: ModuleType, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(setup, "USUAL", {3: 140.0, 4: 60.0})
    with setup.step(3, "working"):
        begun = setup.BEGUN[3]
        seen = [(begun + 200.0, 0.25), (begun + 260.0, 0.5)]
        assert setup.progress_words(begun + 260.0, seen) == "260 s, about 3 min left"  # 2 of this step, 1 of the next
        early = [(begun + 20.0, 0.0), (begun + 30.0, 0.01)]
        assert setup.progress_words(begun + 30.0, early) == "30 s, about 3 min left"
        assert setup.progress_words(begun + 260.0, seen[:1]) == "260 s, longer than usual"


def test_every_step_has_its_usual_time(setup: ModuleType) -> None:
    steps = {int(number) for number in re.findall(r"step\((\d)", SCRIPT.read_text(encoding="utf-8"))}
    assert steps == set(setup.USUAL)


@pytest.mark.parametrize(
    ("log", "words", "share"),
    [
        ("", "at work", None),
        ("nonsense\n", "at work", None),
        ("[3/40] Building C object\n", "[3/40] Building C object", 0.075),
        ("Collecting a\nDownloading a.whl\n", "1 packages, Downloading a.whl", None),
        ("Collecting a\nInstalling collected packages: a, b, c, d\n", "1 of 4 packages installed", 0.25),
    ],
)
def test_the_newest_words_of_a_log(setup: ModuleType, log: str, words: str, share: float | None) -> None:
    for name in ("pip", "b"):
        (setup.VENV / "lib" / "python3" / "site-packages" / f"{name}-1.dist-info").mkdir(parents=True)
    setup.LOG.write_text(log)
    assert setup.newest_words(0, before=1) == (words, share)
