"""What the pages name exists: functions of the paper's equations, files of the architecture, commands of the tasks."""

import ast
import importlib.util
import re
from functools import reduce
from pathlib import Path
from typing import Any

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
CODE = re.compile(r"`([^`\n]+)`")


def names(page: str) -> list[str]:
    """Dotted names in backticks, such as `consensus.assumptions.validate`."""
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


PLACE = re.compile(r"\b(?:src|tests|ros_ws|docs|tools|benches|docker)/[\w./-]*\w")


def pages() -> list[Path]:
    """All that is written by hand."""
    return [*DOCS.rglob("*.md"), *(ROOT / name for name in ("README.md", "CONTRIBUTING.md", "docker/README.md"))]


@pytest.mark.parametrize("page", pages(), ids=lambda page: str(page.relative_to(ROOT)))
def test_places_that_a_page_names_exist(page: Path) -> None:
    places = set(PLACE.findall(page.read_text(encoding="utf-8")))
    assert sorted(place for place in places if not (ROOT / place).exists()) == []


def architecture() -> str:
    return (DOCS / "architecture.md").read_text(encoding="utf-8")


def test_ten_questions_have_one_file_each_for_an_answer() -> None:
    rows = re.findall(r"^\| (Where is [^|]*\?) \| `([^`]+)` \|$", architecture(), re.MULTILINE)
    assert len(rows) == len(dict(rows)) == 10
    assert [file for _, file in rows if not (ROOT / file).is_file()] == []


def folders_of_the_tree() -> list[str]:
    """Folders that the tree of architecture.md shows, by its indentation."""
    found, above = [], list[str]()
    tree = architecture().partition("```\n")[2].partition("```")[0]
    for line in tree.splitlines():
        depth = (len(line) - len(line.lstrip())) // 2
        above = [*above[:depth], line.split()[0].rstrip("/")]
        found.append("/".join(above))
    return found


def test_the_tree_shows_what_is_there() -> None:
    shown = folders_of_the_tree()
    assert [folder for folder in shown if not (ROOT / folder).is_dir()] == []
    packages = [path for path in (ROOT / "src").glob("*/*/") if (path / "__init__.py").exists()]
    inner = [path for path in packages for path in path.iterdir() if (path / "__init__.py").exists()]
    there = {str(path.relative_to(ROOT)) for path in (*packages, *inner)}
    assert sorted(there - set(shown)) == []


def test_the_figure_is_what_its_script_draws() -> None:
    specification = importlib.util.spec_from_file_location("figure", ROOT / "tools" / "architecture_figure.py")
    assert specification
    assert specification.loader
    figure = importlib.util.module_from_spec(specification)
    specification.loader.exec_module(figure)
    assert figure.FILE.read_text(encoding="utf-8") == figure.drawing()


def classes() -> dict[str, set[str]]:
    """Names of the library's classes and what each of them defines."""
    sources = [file.read_text(encoding="utf-8") for file in (ROOT / "src" / "mabirds_core").rglob("*.py")]
    nodes = [node for text in sources for node in ast.walk(ast.parse(text))]
    found = [node for node in nodes if isinstance(node, ast.ClassDef)]
    return {node.name: {part.name for part in node.body if isinstance(part, ast.FunctionDef)} for node in found}


def test_classes_and_methods_of_the_architecture_exist() -> None:
    known = classes()
    named = set(re.findall(r"\b([A-Z][a-z]+(?:[A-Z][a-z]+)*)\.([a-z_]+)\b", architecture()))
    assert ("Learner", "step") in named
    assert {pair for pair in named if pair[1] not in known.get(pair[0], ())} == set()
    spans = {span for span in CODE.findall(architecture()) if re.fullmatch(r"([A-Z][a-z]+){2,}", span)}
    assert spans - set(known) == set()


def test_functions_that_the_pages_name_exist() -> None:
    names = {"build_game", "build_learner", "build_method", "simulate", "simulate_central"}
    text = architecture() + (DOCS / "tasks" / "without-ros.md").read_text(encoding="utf-8")
    assert set(re.findall(r"\b(?:build|simulate)_\w+|\bsimulate\b", text)) == names
    modules = [importlib.import_module(f"mabirds_core.experiment.{name}") for name in ("assembly", "simulate")]
    assert {name for name in names if not any(callable(getattr(one, name, None)) for one in modules)} == set()
