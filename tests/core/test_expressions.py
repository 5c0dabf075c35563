"""Expressions against Python's own arithmetic, and everything that they must refuse."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mabirds_core.expressions import FUNCTIONS, Expression

OPERANDS = st.sampled_from(["x", "y", "2", "0.5", "(x + 1)", "exp(-y)", "abs(x)", "min(x, y, 1)", "max(x, 0.25)"])
FORMULAS = st.lists(OPERANDS, min_size=1, max_size=6).flatmap(
    lambda parts: st.lists(
        st.sampled_from(["+", "-", "*", "<", ">="]), min_size=len(parts) - 1, max_size=len(parts) - 1
    ).map(lambda signs: _joined(parts, signs))
)


def _joined(parts: list[str], signs: list[str]) -> str:
    formula = parts[0]
    for sign, part in zip(signs, parts[1:], strict=True):
        formula = f"({formula}) {sign} {part}"
    return formula


@given(formula=FORMULAS, x=st.floats(-3, 3), y=st.floats(-3, 3))
def test_what_python_makes_of_it(formula: str, x: float, y: float) -> None:
    python = {"exp": math.exp, "abs": abs, "min": min, "max": max, "x": x, "y": y}
    expected = float(eval(formula, {"__builtins__": {}}, python))  # noqa: S307 - of formulas that are made here
    found = Expression(formula)({"x": np.array([x]), "y": np.array([y])})
    assert float(np.broadcast_to(found, 1)[0]) == pytest.approx(expected, rel=1e-12, abs=1e-12)


@pytest.mark.parametrize(
    ("formula", "expected"),
    [
        ("-x ** 2", -9.0),
        ("x ** 0", 1.0),
        ("2 ** 3 * x", 24.0),
        ("sqrt(x * 3)", 3.0),
        ("log(exp(x))", 3.0),
        ("1 / (1 + x)", 0.25),
        ("(x > 2) * (x <= 3)", 1.0),
        ("0 - -x", 3.0),
    ],
)
def test_by_hand(formula: str, expected: float) -> None:
    assert float(Expression(formula)({"x": np.array(3.0)})) == pytest.approx(expected)


def test_names_are_quantities_and_no_functions() -> None:
    assert Expression("exp(-distance) + min(row_1, shade_2) * distance").names == {"distance", "row_1", "shade_2"}
    assert Expression("exp + 1").names == {"exp"}


@pytest.mark.parametrize(
    "text",
    [
        "",
        "1 +",
        "__import__('os').system('true')",
        "x.__class__",
        "x[0]",
        "[x for x in (1, 2)]",
        "lambda: 1",
        "x if x else y",
        "x and y",
        "not x",
        "~x",
        "x @ y",
        "x % 2",
        "x // 2",
        "x == y",
        "1 < x < 2",
        "'a'",
        "True",
        "None",
        "1j",
        "1e200",
        "x ** y",
        "x ** 0.5",
        "x ** -1",
        "2 ** 999",
        "exp()",
        "exp(x, y)",
        "exp(x=1)",
        "exp(*x)",
        "min(x)",
        "open(x)",
        "(y := x)",
        "f'{x}'",
        "x; y",
        "(" * 240 + "x" + ")" * 240,
        "x + " * 200 + "x",
    ],
)
def test_everything_else_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match="expected"):
        Expression(text)


def test_every_function_takes_arrays() -> None:
    values = {"x": np.array([0.5, 2.0])}
    for name in FUNCTIONS:
        arguments = "x, 1" if name in {"min", "max"} else "x"
        assert Expression(f"{name}({arguments})")(values).shape == (2,)
