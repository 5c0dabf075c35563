"""The verbs: each is found, and their list says what they say themselves, without loading them."""

import subprocess
import sys
from pathlib import Path

import pytest
from typer.main import get_command

from mabirds_bringup.application import app
from mabirds_bringup.verbs import VERBS

MABIRDS = str(Path(sys.executable).with_name("mabirds"))


@pytest.mark.parametrize("name", VERBS)
def test_the_list_says_what_a_verb_says_of_itself(name: str) -> None:
    command = get_command(app).commands[name]  # type: ignore[attr-defined]
    words = " ".join(str(command.help).split("\n\n", maxsplit=1)[0].split())
    assert (command.name, words) == (name, VERBS[name].help)


def test_a_verb_that_is_none_is_refused_and_the_nearest_is_named() -> None:
    done = subprocess.run([MABIRDS, "simulat"], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert "No such command 'simulat'. Did you mean 'simulate'?" in done.stderr


def test_the_list_of_verbs_needs_none_of_them() -> None:
    program = (
        "import sys\nfrom mabirds_bringup.application import main\nsys.argv = ['mabirds', '--help']\n"
        "try:\n    main()\nexcept SystemExit:\n    print('loaded', *sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True)
    shown, _, loaded = done.stdout.partition("loaded ")
    assert all(name in shown for name in VERBS)
    assert {"numpy", "rclpy", "pydantic", "polars"} & set(loaded.split()) == set()
