"""Children that die are started again, with growing pauses, and not for ever."""

import os
import signal
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mabirds_bringup.run import supervisor as module
from mabirds_bringup.run.supervisor import AT_ONCE, ProcessDiedError, Supervisor
from mabirds_msgs_py.node_main import EXIT_MOVED

SLEEPER = [sys.executable, "-c", "import time; time.sleep(60)"]


def ending_with(code: int) -> list[str]:
    return [sys.executable, "-c", f"print('last words'); raise SystemExit({code})"]


Make = Callable[..., Supervisor]


@pytest.fixture
def make(tmp_path: Path) -> Iterator[Make]:
    made: list[Supervisor] = []

    def supervisor(commands: dict[str, list[str]], restarts: int = 0, optional: tuple[str, ...] = ()) -> Supervisor:
        made.append(Supervisor(commands, tmp_path, restarts, optional))
        return made[-1]

    yield supervisor
    for one in made:
        one.stop()


def never(_name: str, _code: int) -> bool:
    return False


def look_until(supervisor: Supervisor, condition: Callable[[], object], timeout: float = 20.0) -> list[str]:
    """Look after the children until the condition holds; returns what was said."""
    news, deadline = list[str](), time.monotonic() + timeout
    while not condition():
        assert time.monotonic() < deadline, news
        news += supervisor.poll((), never)
    return news


def running(supervisor: Supervisor) -> list[str]:
    return [name for name, child in supervisor.children.items() if child.process and child.process.exit_code is None]


def test_a_killed_child_is_started_again(make: Make) -> None:
    supervisor = make({"one": SLEEPER, "two": SLEEPER}, restarts=2)
    look_until(supervisor, lambda: len(running(supervisor)) == 2)
    first = supervisor.children["one"].process
    assert first is not None
    os.kill(first.popen.pid, signal.SIGKILL)
    first.popen.wait()
    news = look_until(supervisor, lambda: len(running(supervisor)) == 2)
    assert news == ["one ended with exit code -9 (SIGKILL); starting it again in 0.5 s (1 of 2)"]
    assert supervisor.children["one"].process is not first


def test_a_child_whose_host_has_moved_is_started_again_however_often(make: Make) -> None:
    supervisor, news = make({"one": ending_with(EXIT_MOVED)}, restarts=0), list[str]()
    while len(news) < 3:
        news += supervisor.poll((), never)
    assert set(news) == {"one is started again, since addresses of this host have changed"}


def test_a_child_that_is_started_again_on_purpose_counts_no_death(make: Make) -> None:
    supervisor = make({"one": SLEEPER}, restarts=0)
    look_until(supervisor, lambda: running(supervisor))
    first = supervisor.children["one"].process
    supervisor.restart("one")
    assert running(supervisor) == []
    assert look_until(supervisor, lambda: running(supervisor)) == []
    assert supervisor.children["one"].process is not first


def test_pauses_double_and_the_last_death_ends_the_run(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FIRST_PAUSE", 0.01)
    supervisor = make({"one": ending_with(7)}, restarts=3)
    with pytest.raises(ProcessDiedError, match=r"one ended with exit code 7; the end of .*one\.log:\n(last words\n?)+"):
        look_until(supervisor, lambda: False)
    assert supervisor.children["one"].restarts == 3


def test_restarts_come_back_to_a_child_that_lived(make: Make, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "FIRST_PAUSE", 0.01)
    monkeypatch.setattr(module, "HEALTHY", 0.0)
    supervisor, news = make({"one": ending_with(7)}, restarts=1), list[str]()
    while len(news) < 3:
        news += look_until(supervisor, lambda: True) or supervisor.poll((), never)
    assert {words.split("; ")[1] for words in news} == {"starting it again in 0.01 s (1 of 1)"}


def test_refused_input_is_not_tried_again(make: Make) -> None:
    supervisor = make({"one": ending_with(2)}, restarts=5)
    with pytest.raises(ProcessDiedError, match="one ended with exit code 2"):
        look_until(supervisor, lambda: False)


def test_what_is_expendable_does_not_end_the_run(make: Make) -> None:
    supervisor = make({"one": ending_with(7), "two": SLEEPER}, optional=("one",))
    news = look_until(supervisor, supervisor.failed)
    assert news == ["one ended with exit code 7; going on without it"]
    assert supervisor.failed() == ["one"]
    assert supervisor.poll((), never) == []
    assert running(supervisor) == ["two"]


def test_a_child_that_is_done_may_end(make: Make) -> None:
    supervisor = make({"one": ending_with(0)})
    supervisor.poll((), never)
    process = supervisor.children["one"].process
    assert process is not None
    process.popen.wait()
    assert supervisor.poll((), lambda name, code: (name, code) == ("one", 0)) == []


def test_many_children_start_a_few_at_a_time(make: Make) -> None:
    supervisor = make({f"child_{k}": SLEEPER for k in range(AT_ONCE + 4)})
    supervisor.poll((), never)
    assert len(running(supervisor)) == AT_ONCE
    supervisor.poll((), never)
    assert len(running(supervisor)) == AT_ONCE
    supervisor.poll(("child_0", "child_1", "child_2"), never)
    assert len(running(supervisor)) == AT_ONCE + 3
