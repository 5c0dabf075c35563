"""The README is short, its Python runs where there is no ROS, and its links lead somewhere."""

import re
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
README = (ROOT / "README.md").read_text(encoding="utf-8")
WITHOUT_ROS = "import sys\nfor name in ('rclpy', 'mabirds_msgs', 'mabirds_msgs_py'): sys.modules[name] = None\n"


def test_it_is_read_in_one_go() -> None:
    assert len(README.splitlines()) < 80


def test_twelve_lines_of_python_learn_something() -> None:
    (lines,) = re.findall(r"```python\n(.*?)```", README, re.DOTALL)
    assert len([line for line in lines.splitlines() if line]) == 12
    command = [sys.executable, "-c", WITHOUT_ROS + lines]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=280, check=False)
    assert done.returncode == 0, done.stderr
    rates = re.findall(r"(\w+) ImitationMetrics\(violation_rate=([^,]+), success_rate=([^)]+)\)", done.stdout)
    assert [name for name, _, _ in rates] == ["learner_1", "learner_2"]
    assert all(float(violations) < 0.001 and float(success) > 0.999 for _, violations, success in rates)


def test_its_links_and_pictures_are_there() -> None:
    places = re.findall(r"\]\(([^)#]+)", README)
    assert len(places) > 10
    assert [place for place in places if not place.startswith("https:") and not (ROOT / place).exists()] == []


def test_it_names_the_two_commands() -> None:
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    for target in ("run", "test", "docs"):
        assert f"make {target}" in README
        assert re.search(rf"^{target}:", makefile, re.MULTILINE)
