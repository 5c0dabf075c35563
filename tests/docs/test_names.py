"""What the pages name exists: functions of the paper's equations, files of the architecture, commands of the tasks."""

import importlib
import re
from functools import reduce
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
CODE = re.compile(r"`([^`\n]+)`")


def names(page: str) -> list[str]:
    """Dotted names in backticks, such as `consensus.schedule.validate`."""
    spans = CODE.findall((DOCS / page).read_text(encoding="utf-8"))
    return sorted({span for span in spans if re.fullmatch(r"[a-z]\w*(\.\w+)+", span)})


def resolved(name: str) -> Any:
    """The object of a dotted name below mabirds_core: the longest prefix is a module, the rest are attributes."""
    parts = ["mabirds_core", *name.split(".")]
    for length in range(len(parts), 0, -1):
        try:
            module = importlib.import_module(".".join(parts[:length]))
        except ModuleNotFoundError:
            continue
        return reduce(getattr, parts[length:], module)
    raise ModuleNotFoundError(name)


@pytest.mark.parametrize("name", names("equations.md"))
def test_a_name_of_the_equations_exists(name: str) -> None:
    assert resolved(name) is not None


def test_the_equations_name_many() -> None:
    assert len(names("equations.md")) > 50


def test_a_wrong_name_is_seen() -> None:
    with pytest.raises(AttributeError):
        resolved("consensus.schedule.no_such_function")
    with pytest.raises(AttributeError):
        resolved("no_such_folder.schedule")
