"""The packages of examples/, built and installed apart from the repository's environment."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PACKAGES = ("junction", "sight", "tempered", "untouched")

Run = Callable[..., str]


@pytest.fixture(scope="session")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where the four wheels are installed; nothing else knows of the place."""
    wheels, site = tmp_path_factory.mktemp("wheels"), tmp_path_factory.mktemp("site")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", "-q"]
    sources = [str(copy_of(EXAMPLES / name, tmp_path_factory.mktemp(name))) for name in PACKAGES]
    build = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(wheels), *sources]
    subprocess.run(build, check=True, timeout=120)
    install = [*pip, "install", "--no-deps", "--target", str(site), *map(str, sorted(wheels.glob("*.whl")))]
    subprocess.run(install, check=True, timeout=120)
    return site


def copy_of(package: Path, place: Path) -> Path:
    """The package's sources elsewhere: building leaves files behind, and an older build must not be taken for them."""
    sources = [file for file in package.rglob("*") if file.suffix in {".py", ".toml"}]
    for file in (file for file in sources if "build" not in file.relative_to(package).parts):
        target = place / file.relative_to(package)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(file.read_bytes())
    return place


@pytest.fixture
def environment(site: Path) -> dict[str, str]:
    """Of processes that find the packages, before all others."""
    places = [str(site), *filter(None, [os.environ.get("PYTHONPATH")])]
    return {**os.environ, "PYTHONPATH": os.pathsep.join(places)}


@pytest.fixture
def run(environment: dict[str, str], tmp_path: Path) -> Run:
    """A function that runs a Python program, or a module with arguments, where the packages are installed."""

    def run_python(*arguments: str, code: int = 0) -> str:
        command = [sys.executable, *arguments]
        done = subprocess.run(
            command, env=environment, cwd=tmp_path, capture_output=True, text=True, timeout=120, check=False
        )
        assert done.returncode == code, done.stderr
        return done.stdout if code == 0 else done.stderr

    return run_python
