"""``mabirds bench`` as somebody at a terminal runs it."""

import json
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

MABIRDS = str(Path(sys.executable).with_name("mabirds"))


def printed(cwd: Path, *arguments: str) -> dict[str, Any]:
    """What ``mabirds bench ARGUMENTS --json`` prints: one object, in which NaN would be no JSON."""
    command = [MABIRDS, "bench", *arguments, "--json"]
    done = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=240, check=False)
    assert done.returncode == 0, done.stderr
    content: dict[str, Any] = json.loads(done.stdout, parse_constant=pytest.fail)
    return content
