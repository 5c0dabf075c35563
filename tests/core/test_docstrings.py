"""Docstrings: examples of mabirds_core run and show what they say, sections of all packages say what the code has."""

import ast
import doctest
import importlib
import pkgutil
import re
import textwrap
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import griffe
import pytest

import mabirds_core

MODULES = sorted(module.name for module in pkgutil.walk_packages(mabirds_core.__path__, "mabirds_core."))
SOURCES = Path(__file__).resolve().parents[2] / "src"
PARAMETERS = griffe.DocstringSectionKind.parameters
RESULTS = (griffe.DocstringSectionKind.returns, griffe.DocstringSectionKind.yields)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_hold(name: str) -> None:
    assert doctest.testmod(importlib.import_module(name)).failed == 0


def test_examples_are_found() -> None:
    """Else the test above would pass for want of examples."""
    attempted = [doctest.testmod(importlib.import_module(name)).attempted for name in MODULES]
    assert "mabirds_core.games.patrol.game" in MODULES
    assert sum(attempted) >= 3


def loaded(name: str, folder: Path) -> griffe.Module:
    """A package or module as the API pages read it."""
    module = griffe.load(name, search_paths=[folder], docstring_parser="numpy")
    assert isinstance(module, griffe.Module)
    return module


def members(parent: griffe.Module | griffe.Class) -> Iterator[griffe.Object]:
    """What is public in a module or class, and in what it holds."""
    for member in parent.members.values():
        if isinstance(member, griffe.Object) and not member.name.startswith("_"):
            yield member
            if isinstance(member, griffe.Module | griffe.Class):
                yield from members(member)


def protocols(package: griffe.Module) -> list[griffe.Class]:
    classes = (member for member in members(package) if isinstance(member, griffe.Class))
    return [given for given in classes if any(str(base).startswith("Protocol") for base in given.bases)]


def implements(given: griffe.Class, protocol: griffe.Class) -> bool:
    """Whether a class has all methods that a protocol asks for, its own and what it inherits."""
    asked = {name for name, member in protocol.all_members.items() if isinstance(member, griffe.Function)}
    return asked <= given.all_members.keys()


def described_elsewhere(function: griffe.Function, package: griffe.Module) -> bool:
    """Whether a base class, or a protocol that the class or one derived from it implements, has the same method."""
    owner = function.parent
    if not isinstance(owner, griffe.Class):
        return False
    derived = [given for given in members(package) if isinstance(given, griffe.Class) and owner in given.mro()]
    interfaces = [known for known in protocols(package) if any(implements(given, known) for given in [owner, *derived])]
    others = [other.all_members.get(function.name) for other in [*owner.mro(), *interfaces] if other is not owner]
    methods = [other for other in others if isinstance(other, griffe.Function) and other.path != function.path]
    return any(names(method) == names(function) and method.docstring for method in methods)


def parameters(function: griffe.Function) -> list[griffe.Parameter]:
    """The parameters without self and cls."""
    bound = isinstance(function.parent, griffe.Class) and "staticmethod" not in function.labels
    return list(function.parameters)[bound:]


def names(function: griffe.Function) -> list[str]:
    """The parameters as docstrings write them."""
    stars = {griffe.ParameterKind.var_positional: "*", griffe.ParameterKind.var_keyword: "**"}
    return [stars.get(given.kind, "") + given.name for given in parameters(function)]


def raised(function: griffe.Function) -> set[str]:
    """Names of the exceptions that a function raises in its own body."""
    lines = function.lines_collection[function.filepath][function.lineno - 1 : function.endlineno]
    body = ast.parse(textwrap.dedent("\n".join(lines)))
    thrown = [node.exc for node in ast.walk(body) if isinstance(node, ast.Raise)]
    raisers = [error.func if isinstance(error, ast.Call) else error for error in thrown]
    return {raiser.id for raiser in raisers if isinstance(raiser, ast.Name)}


def written(given: griffe.Object) -> dict[griffe.DocstringSectionKind, list[Any]]:
    """Items of the docstring by kind of section."""
    parsed = given.docstring.parsed if given.docstring else []
    return {section.kind: section.value for section in parsed if isinstance(section.value, list)}


def types(text: object) -> str:
    """A type with nothing that is a matter of taste: ``X or None`` for ``X | None``, ``numpy`` for ``np``."""
    return str(text).replace(" or ", " | ").replace("numpy.", "np.").translate(str.maketrans("", "", "'\" "))


def agree(described: object, annotation: object, *, optional: bool = False) -> bool:
    """Whether a docstring has the type of the code, perhaps without brackets; what is optional may leave None out."""
    whole = types(annotation)
    return types(described) in {whole, whole.split("[")[0], whole.removesuffix("|None") if optional else whole}


def faults_of_parameters(function: griffe.Function) -> Iterator[str]:
    described = written(function).get(PARAMETERS)
    if described is not None or len(parameters(function)) > 1:
        yield from faults_of_items(described or [], function)


def faults_of_items(described: list[griffe.DocstringParameter], function: griffe.Function) -> Iterator[str]:
    """What is wrong with a section of parameters."""
    if [item.name for item in described] != names(function):
        yield f"Parameters has {[item.name for item in described]}, expected {names(function)}"
    for item, parameter in zip(described, parameters(function), strict=False):
        if not agree(item.annotation, parameter.annotation, optional=parameter.default is not None):
            yield f"Parameters has {item.name} : {item.annotation}, expected {parameter.annotation}"


def faults_of_results(function: griffe.Function) -> Iterator[str]:
    """Several values have an item each."""
    sections, result = written(function), str(function.returns)
    items = [types(item.annotation) for kind in RESULTS for item in sections.get(kind, ())]
    if not items and (result in {"None", "NoReturn"} or len(parameters(function)) < 2):
        return
    text = ",".join(items)
    if not agree(text, result) and types(result) not in {f"tuple[{text}]", f"Iterator[{text}]"}:
        yield f"Returns or Yields has {items}, expected {result}"


def prose(given: griffe.Object, described: list[str]) -> list[str]:
    """What a docstring says outside of sections of parameters and exceptions."""
    parsed = given.docstring.parsed if given.docstring else []
    text = "".join(section.value for section in parsed if isinstance(section.value, str))
    choice = "|".join(re.escape(name) for name in described)
    return re.findall(rf"[Rr]aises? \w+Error|``(?:{choice})``:", text)


def faults_of_class(given: griffe.Class) -> Iterator[str]:
    """Attributes are the fields, Parameters those of ``__init__``; neither has to be there."""
    fields = {name: member for name, member in given.members.items() if is_field(member)}
    attributes = written(given).get(griffe.DocstringSectionKind.attributes)
    if attributes is not None and [item.name for item in attributes] != list(fields):
        yield f"Attributes has {[item.name for item in attributes]}, expected {list(fields)}"
    for item in attributes or ():
        field = fields.get(item.name)
        if field and not agree(item.annotation, field.annotation):
            yield f"Attributes has {item.name} : {item.annotation}, expected {field.annotation}"
    init, described = given.members.get("__init__"), written(given).get(PARAMETERS)
    taken = names(init) if isinstance(init, griffe.Function) else []
    if isinstance(init, griffe.Function) and described is not None:
        yield from faults_of_items(described, init)
    yield from (f"says in prose what belongs into a section: {words}" for words in prose(given, [*fields, *taken]))


def is_field(member: griffe.Object | griffe.Alias) -> bool:
    """Whether it is a public attribute with a type, and no property."""
    typed = isinstance(member, griffe.Attribute) and member.annotation is not None
    return typed and "property" not in member.labels and not member.name.startswith("_")


def faults(function: griffe.Function) -> Iterator[str]:
    """What the sections lack or say wrongly. What takes less than two parameters needs no sections but Raises."""
    yield from faults_of_parameters(function)
    yield from faults_of_results(function)
    yield from (f"says in prose what belongs into a section: {words}" for words in prose(function, names(function)))
    described = {str(item.annotation) for item in written(function).get(griffe.DocstringSectionKind.raises, ())}
    if missing := raised(function) - described:
        yield f"Raises has {sorted(described)}, expected {sorted(missing)} too"


def all_faults(package: griffe.Module, chosen: list[griffe.Object]) -> list[str]:
    functions = [
        (member, fault) for member in chosen if isinstance(member, griffe.Function) for fault in faults(member)
    ]
    classes = [member for member in chosen if isinstance(member, griffe.Class)]
    return [
        *(f"{member.path}: {fault}" for member, fault in functions if not described_elsewhere(member, package)),
        *(f"{given.path}: {fault}" for given in classes for fault in faults_of_class(given)),
    ]


@pytest.mark.parametrize("name", ["mabirds_core", "mabirds_msgs_py", "mabirds_expert_player", "mabirds_learner"])
def test_sections_say_what_the_code_has(name: str) -> None:
    package = loaded(name, SOURCES / name)
    chosen = list(members(package))
    assert len(chosen) > 30
    missing = all_faults(package, chosen)
    assert not missing, "\n".join([f"{len(missing)} faults", *missing])


MADE_UP = """
from typing import Protocol

class Adder(Protocol):
    def add(self, first: int, second: str | None = None) -> float | None:
        '''Add two things.

        Parameters
        ----------
        first : int
            One.
        second : str, optional
            Another.

        Returns
        -------
        float or None
            Their sum.

        Raises
        ------
        ValueError
            They have none.
        '''
        raise ValueError(first)

class Implements:
    '''An adder.

    Attributes
    ----------
    unit : str or None
        Of numbers.
    '''

    unit: str | None = None
    _secret: int = 0

    def __init__(self, unit: str | None = None) -> None: ...

    def add(self, first: int, second: str | None = None) -> float | None:
        '''Described by the protocol, which is not its base.'''
"""


@pytest.mark.parametrize(
    ("old", "new", "complaints"),
    [
        ("", "", []),
        ("(Protocol)", "", ["Parameters", "Returns"]),
        ("        second : str, optional\n            Another.\n", "", ["Parameters"]),
        ("first : int\n", "number : int\n", ["Parameters"]),
        ("first : int\n", "first : float\n", ["Parameters"]),
        ("float or None\n", "float\n", ["Returns"]),
        ("        Returns\n        -------\n        float or None\n            Their sum.\n", "", ["Returns"]),
        ("        ValueError\n", "        TypeError\n", ["Raises"]),
        ("Add two things.", "Add two things; raises KeyError where ``first``: is large.", ["says", "says"]),
        ("def add", "def _add", []),
        ("    unit : str or None\n", "    units : str or None\n", ["Attributes"]),
        ("    unit : str or None\n", "    unit : str\n", ["Attributes"]),
        ("An adder.", "An adder with ``unit``: metres.", ["says"]),
        ("Attributes\n    ----------", "Parameters\n    ----------", []),
        ("Attributes\n    ----------\n    unit", "Parameters\n    ----------\n    units", ["Parameters"]),
    ],
)
def test_what_sections_lack_is_seen(tmp_path: Path, old: str, new: str, complaints: list[str]) -> None:
    (tmp_path / "made_up.py").write_text(MADE_UP.replace(old, new))
    package = loaded("made_up", tmp_path)
    assert [fault.split(": ", 1)[1].split()[0] for fault in all_faults(package, list(members(package)))] == complaints
