"""What pages tell people to type: commands and options that exist, Python that runs, an experiment that loads."""

import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from typer.main import get_command

from mabirds_bringup.application import app
from mabirds_core.experiment.file import load_experiment

ROOT = Path(__file__).resolve().parents[2]
TASKS = ROOT / "docs" / "tasks"
PAGES = [*sorted((ROOT / "docs").glob("**/*.md")), ROOT / "README.md", ROOT / "docker" / "README.md"]


def blocks(page: Path, language: str) -> list[str]:
    """Blocks of code in a language, without their indentation."""
    found = re.findall(
        rf"^( *)```{language}[^\n]*\n(.*?)^ *```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE
    )
    return [re.sub(rf"^{indent}", "", text, flags=re.MULTILINE) for indent, text in found]


def commands(page: Path) -> Iterator[str]:
    """Every ``mabirds`` command of the page's blocks and spans of code."""
    text = page.read_text(encoding="utf-8")
    yield from re.findall(r"^(?:host \d: +|any: +| *)(mabirds [^#\n\\]+)", text, re.MULTILINE)
    yield from re.findall(r"`(mabirds [a-z][^`]+)`", text)


def wrong_words(line: str) -> list[str]:
    """Words of a command that name no verb, and options that the verb has not."""
    command: Any = get_command(app)
    _, *words = shlex.split(line)
    while verbs := getattr(command, "commands", None):
        if not words:
            return []
        if words[0].startswith("--"):
            break  # an option of the group itself
        verb = words.pop(0)
        if verb.endswith(".yaml"):
            verb = "STUDY"  # the file of a study, where `mabirds bench` takes a name
        if verb not in verbs:
            return [verb]
        command = verbs[verb]
    known = {name for parameter in command.params for name in parameter.opts} | {"--help"}
    return [word for word in words if word.startswith("--") and word not in known]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_of_a_page_exist(page: Path) -> None:
    assert {line: wrong for line in commands(page) if (wrong := wrong_words(line))} == {}


def test_commands_are_found_and_wrong_ones_seen() -> None:
    assert len(list(commands(TASKS / "replay-faster.md"))) >= 3
    assert wrong_words("mabirds run a.yaml --speed 3") == ["--speed"]
    assert wrong_words("mabirds bag destroy") == ["destroy"]


def test_the_map_of_the_page_is_an_experiment(tmp_path: Path) -> None:
    (text,) = blocks(TASKS / "my-own-map.md", "yaml")
    file = tmp_path / "my_map.yaml"
    file.write_text(text, encoding="utf-8")
    assert load_experiment(file).name == "my_map"


def run_python(text: str, folder: Path) -> str:
    command = [sys.executable, "-c", text]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=250, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_the_python_of_without_ros_runs() -> None:
    (text,) = blocks(TASKS / "without-ros.md", "python")
    told = run_python(text, ROOT)
    assert len(re.findall(r"^learner_\d: \d+ constraints, the surest: \w", told, re.MULTILINE)) == 2
    assert "consensus distance of theta: " in told


def test_the_python_of_read_the_results_reads_a_run(tmp_path: Path) -> None:
    (text,) = blocks(TASKS / "read-the-results.md", "python")
    run = tmp_path / "runs" / "latest"
    run.mkdir(parents=True)
    (run / "summary.json").write_text('{"learners": {"learner_1": {}}}', encoding="utf-8")
    (run / "metrics.csv").write_text(
        "learner,iteration,success_rate\nlearner_1,1,0.5\nlearner_1,2,1.0\n", encoding="utf-8"
    )
    told = run_python(text, tmp_path)
    assert told == "learner_1: success at the end 1.000, worst of the last 15 iterations 0.500\n"
