"""Long work says how far it is and how long it still takes, in a terminal and elsewhere."""

import io
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from rich.console import Console

from mabirds_bringup import console as shown
from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate_from_bag
from mabirds_bringup.evaluate.evaluation import evaluate, tasks_of
from mabirds_bringup.evaluate.policies import PolicyJudge
from mabirds_core.experiment.file import load_experiment


@pytest.fixture
def told(monkeypatch: pytest.MonkeyPatch) -> io.StringIO:
    """What is said where no terminal is."""
    stream = io.StringIO()
    monkeypatch.setattr(shown, "console", Console(file=stream, force_terminal=False, width=80))
    monkeypatch.setattr(shown, "NEWS", 0.05)
    return stream


def wait_for(told: io.StringIO, words: str) -> None:
    deadline = time.monotonic() + 20
    while words not in told.getvalue():
        assert time.monotonic() < deadline, told.getvalue()
        time.sleep(0.02)


def test_lines_tell_how_far_it_is_and_how_long_it_takes(told: io.StringIO) -> None:
    with shown.progress_bar() as bar:
        task = bar.add_task("recording", total=4)
        wait_for(told, "recording 0/4, 0s\n")  # before the first step, too
        for _ in range(2):
            bar.advance(task)
            time.sleep(0.1)
        wait_for(told, "recording 2/4, ")
        wait_for(told, "s left\n")
        bar.advance(task, 2)
    length = len(told.getvalue())
    time.sleep(0.2)
    assert len(told.getvalue()) == length


def test_a_terminal_has_a_bar_and_no_lines(told: io.StringIO, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shown, "console", Console(file=told, force_terminal=True, width=80))
    with shown.progress_bar() as bar:
        task = bar.add_task("recording", total=2)
        bar.advance(task)
        time.sleep(0.3)
    assert "recording 1/2" not in told.getvalue()
    assert "1/2" in told.getvalue()


def test_an_evaluation_takes_as_many_steps_as_it_says(make_experiment: Callable[..., Path]) -> None:
    experiment = load_experiment(make_experiment(iterations=3))
    history, steps = simulate_from_bag(experiment), list[Any]()
    evaluate(experiment, history, demonstrations_of(experiment), steps.append)
    assert len(steps) == len(tasks_of(PolicyJudge(experiment), history)) == 8
