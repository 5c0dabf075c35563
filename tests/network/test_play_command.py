"""``mabirds play`` in a terminal, by its keys, and ``mabirds player`` from another."""

import json
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from pretend_learners import PretendLearners
from terminal import Terminal

from mabirds_core.experiment.file import load_experiment

MABIRDS = str(Path(sys.executable).with_name("mabirds"))
UP, DOWN, RIGHT, LEFT = "\x1b[A", "\x1b[B", "\x1b[C", "\x1b[D"


@pytest.fixture
def file(make_experiment: Callable[..., Path]) -> Path:
    return make_experiment(iterations=30)


@pytest.fixture
def play(file: Path, tmp_path: Path) -> Iterator[Callable[..., Terminal]]:
    """A function that starts ``mabirds play`` in a terminal."""
    started: list[Terminal] = []

    def start(*options: str) -> Terminal:
        command = [MABIRDS, "play", str(file), *options]
        started.append(Terminal(command, {"ROS_LOG_DIR": str(tmp_path / "log")}))
        return started[-1]

    yield start
    for terminal in started:
        terminal.close()


def ask(*words: object) -> tuple[int, str]:
    """Exit code and words of ``mabirds player``."""
    command = [MABIRDS, "player", *map(str, words)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    return done.returncode, " ".join((done.stdout + done.stderr).split())


def test_keys_and_the_bar(play: Callable[..., Terminal]) -> None:
    terminal = play("--listeners", "--start-paused", "--rate", "2")
    here = terminal.until("paused 2x, 0.0 of 29.0 s")
    terminal.until("space pause, right next, up/down rate")
    terminal.press(RIGHT)
    here = terminal.until("learner_1 1/30; learner_2 0/30", here)
    terminal.press(RIGHT + RIGHT)
    here = terminal.until("learner_1 2/30; learner_2 1/30", here)
    terminal.press(UP)
    here = terminal.until("rate 2.2", here)
    terminal.press(DOWN + DOWN)
    here = terminal.until("rate 1.98", here)
    terminal.until("rate 1.782", here)
    terminal.press("f")
    here = terminal.until("seek to 1700000010.000 s: learner_1 at 11, learner_2 at 11", here)
    terminal.press(LEFT)
    here = terminal.until("seek to 1700000000.000 s: learner_1 at 1, learner_2 at 1", here)
    terminal.press(" ")
    here = terminal.until("playing at rate 1.782", here)
    terminal.until("playing 1.782x, 2.", here)
    terminal.until("━", here)
    terminal.press(" ")
    here = terminal.until("paused 1.782x", here)
    terminal.press("q")
    terminal.until("stopped", here)
    assert terminal.process.wait(10) == 0


def test_status_next_rate_and_stop(play: Callable[..., Terminal]) -> None:
    terminal = play("--listeners", "--start-paused")
    terminal.until("paused 1x")
    code, words = ask("status", "--json")
    content = json.loads(words[words.index("{") : words.rindex("}") + 1])
    assert (code, content["state"], content["rate"], content["total_seconds"]) == (0, "paused", 1.0, 29.0)
    assert content["learners"]["learner_1"] == {"sent": 0, "total": 30, "learned": 0, "consumes": False}
    assert ask("next", 3) == (0, "published 3")
    terminal.until("learner_1 2/30; learner_2 1/30")
    assert ask("rate", 0.25) == (0, "rate 0.25")
    code, words = ask("rate", 1e30)
    assert code == 2
    assert "error: rate unchanged: Parameter rate out of range" in words
    assert ask("stop") == (0, "stopped")
    assert terminal.process.wait(10) == 0


def test_seek_resume_and_pause(play: Callable[..., Terminal]) -> None:
    terminal = play("--listeners", "--start-paused", "--rate", "0.25")
    terminal.until("paused 0.25x")
    assert ask("seek", 20) == (0, "seek to 1700000020.000 s: learner_1 at 21, learner_2 at 21")
    code, words = ask("seek", 400)
    assert code == 2
    assert "error: no seek: 1700000400.000 s is not in the recording" in words
    assert ask("resume") == (0, "playing at rate 0.25")
    assert ask("next") == (2, "error: no step: it is playing; pause it first")
    assert ask("pause") == (0, "paused")


def test_without_a_player_it_says_so() -> None:
    code, words = ask("pause", "--timeout", 1)
    assert code == 4
    assert "no player /expert_player is heard within 1 s; start one by `mabirds play`" in words


def test_it_waits_for_learners_and_plays_to_them(play: Callable[..., Terminal], nodes: Any, file: Path) -> None:
    terminal = play("--rate", "1e9", "--max-in-flight", "4", "--json")
    terminal.until("nothing heard of learner_1, learner_2")
    learners = PretendLearners(nodes, load_experiment(file))

    def learned() -> bool:
        for name in ("learner_1", "learner_2"):
            learners.acknowledge(name, max(learners.received[name], default=0))
        return terminal.process.poll() is not None

    nodes.spin_until(learned)
    assert terminal.process.returncode == 0
    assert learners.received == {name: list(range(1, 31)) for name in ("learner_1", "learner_2")}


def test_without_a_terminal_it_plays_and_tells_in_lines(file: Path) -> None:
    command = [MABIRDS, "play", str(file), "--listeners", "--rate", "100", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False, stdin=subprocess.DEVNULL)
    assert done.returncode == 0
    assert json.loads(done.stdout)["learners"]["learner_2"]["sent"] == 30
    assert "finished 100x, 29.0 of 29.0 s" in done.stderr
