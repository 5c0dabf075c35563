"""The documentation builds without a warning, and its reference pages say what the code says."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The built site; a warning of mkdocs, mkdocstrings or griffe ends the build."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    built = subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=250, check=False)
    assert built.returncode == 0, built.stdout + built.stderr
    assert "WARNING" not in built.stdout + built.stderr
    return folder


def text(site: Path, page: str) -> str:
    return (site / f"{page}.html").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("page", "words"),
    [
        ("commands", ["mabirds run", "mabirds schedule make", "--restarts", "mabirds-expert-player", "130"]),
        (
            "settings",
            ["constraint_threshold", "PatrolSettings", "DroneSettings", "rosbag2 directory", "at most 1000000"],
        ),
        ("parameters", ["parameter_history", "0 to 100000", "may change while the node runs", "late_joiner"]),
        ("topics", ["/learner_1/mass/learner_2", "lease 3 s", "mabirds_msgs/Demonstration", "/expert_player/resend"]),
        ("messages", ["LearnerStatus", "FetchParameters", "float64[]"]),
        ("files", ["summary.json", "violation_rate"]),
    ],
)
def test_a_reference_page_holds_what_the_code_declares(site: Path, page: str, words: list[str]) -> None:
    content = text(site, f"reference/{page}")
    assert [word for word in words if word not in content] == []


def test_every_module_of_the_library_has_its_place(site: Path) -> None:
    library = ROOT / "src" / "mabirds_core" / "mabirds_core"
    pages = "".join(page.read_text(encoding="utf-8") for page in (site / "api").glob("*.html"))
    names = [
        ".".join(file.relative_to(library.parent).with_suffix("").parts)
        for file in library.rglob("*.py")
        if file.name != "__init__.py"
    ]
    assert [name for name in names if f'id="{name}"' not in pages] == []


def test_pages_fetch_nothing(site: Path) -> None:
    foreign = ("https://fonts.", "https://unpkg.", "https://cdn.")
    pages = {page.name: page.read_text(encoding="utf-8") for page in site.rglob("*.html")}
    assert [name for name, content in pages.items() if any(place in content for place in foreign)] == []
