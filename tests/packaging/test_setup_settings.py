"""Set-up takes from the user's pip settings what does no harm."""

import importlib.util
import sys
from pathlib import Path

import pytest

SCRIPT = Path(__file__).resolve().parents[2] / "tools" / "setup_workspace.py"


def test_where_packages_come_from_and_whether_they_are_compiled_is_the_users_to_say(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    specification = importlib.util.spec_from_file_location("setup_workspace", SCRIPT)
    assert specification
    assert specification.loader
    setup = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(setup)
    monkeypatch.setattr(setup, "VENV_PYTHON", sys.executable)
    settings = tmp_path / "pip.conf"
    settings.write_text("[install]\nno-compile = true\nno-deps = true\n", encoding="utf-8")
    monkeypatch.setenv("PIP_CONFIG_FILE", str(settings))
    monkeypatch.delenv("PIP_NO_COMPILE", raising=False)
    monkeypatch.setenv("PIP_FIND_LINKS", "/wheels  /more")
    monkeypatch.setenv("PIP_USER", "1")
    kept = setup.pip_environment()
    assert (kept["PIP_NO_COMPILE"], kept["PIP_FIND_LINKS"]) == ("true", "/wheels /more")
    assert not {"PIP_NO_DEPS", "PIP_USER"} & kept.keys()
