"""Expressions over named quantities, as experiment files have them: arithmetic, a few functions, and nothing else.

An expression is read by Python's grammar, and refused where it has anything but numbers, names, + - * /, powers by
small whole numbers, comparisons (1 where true, 0 elsewhere) and calls of FUNCTIONS. It is never run as code. exp and
log are of fixed arithmetic, so that an expression has the same bits on every processor.
"""

import ast
import operator
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, reduce
from typing import Any, cast

import numpy as np

from mabirds_core.arithmetic import exp, log
from mabirds_core.arrays import Array

MAX_CHARACTERS = 300
"""Of an expression."""
MAX_NUMBER = 1e100
MAX_POWER = 16
"""Larger ones are no costs."""

FUNCTIONS: Mapping[str, Callable[..., Array]] = {
    "exp": exp,
    "log": log,
    "sqrt": np.sqrt,
    "abs": np.abs,
    "min": lambda *values: reduce(np.minimum, values),
    "max": lambda *values: reduce(np.maximum, values),
}
OF_SEVERAL = ("min", "max")
"""They take two values or more, all others one."""

OPERATORS: Mapping[type[ast.AST], Callable[..., Array]] = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.USub: operator.neg,
    ast.Lt: operator.lt,
    ast.LtE: operator.le,
    ast.Gt: operator.gt,
    ast.GtE: operator.ge,
}
WHAT_MAY_BE = "numbers, names, + - * /, ** by a whole number, < <= > >= and calls of " + ", ".join(FUNCTIONS)


@dataclass(frozen=True)
class Expression:
    """A formula.

    Attributes
    ----------
    text : str
        As written.

    Raises
    ------
    ValueError
        It is none, or has something that it may not have.

    Examples
    --------
    >>> Expression("exp(-distance / 2) * (distance < 3)").names
    frozenset({'distance'})
    >>> float(Expression("2 * x ** 2 + 1")({"x": np.array(3.0)}))
    19.0
    """

    text: str

    def __post_init__(self) -> None:
        _check(self.text, self._tree)

    @cached_property
    def _tree(self) -> ast.expr:
        if len(self.text) > MAX_CHARACTERS:
            raise ValueError(f"an expression of {len(self.text)} characters: expected at most {MAX_CHARACTERS}")
        try:
            return ast.parse(self.text.strip(), mode="eval").body
        except (SyntaxError, ValueError, RecursionError, MemoryError):
            raise ValueError(f"{self.text!r} is no expression; expected {WHAT_MAY_BE}") from None

    @cached_property
    def names(self) -> frozenset[str]:
        """Quantities that it asks for."""
        called = {id(node.func) for node in ast.walk(self._tree) if isinstance(node, ast.Call)}
        names = (node for node in ast.walk(self._tree) if isinstance(node, ast.Name))
        return frozenset(node.id for node in names if id(node) not in called)

    def __call__(self, quantities: Mapping[str, Array]) -> Array:
        """Evaluate it.

        Parameters
        ----------
        quantities : Mapping[str, Array]
            By name, of one shape.

        Returns
        -------
        Array
            Of that shape; infinite or NaN where the formula has no value.
        """
        with np.errstate(all="ignore"):
            return np.asarray(_value(self._tree, quantities), dtype=np.float64)


def _check(text: str, tree: ast.expr) -> None:
    for node in ast.walk(tree):
        if not _may_be(node):
            raise ValueError(f"{text!r} has {ast.unparse(node) or type(node).__name__!r}; expected {WHAT_MAY_BE}")


def _may_be(node: ast.AST) -> bool:
    if isinstance(node, ast.Constant):
        return isinstance(node.value, int | float) and not isinstance(node.value, bool) and node.value < MAX_NUMBER
    if isinstance(node, ast.Call):
        if not isinstance(node.func, ast.Name) or node.func.id not in FUNCTIONS or node.keywords:
            return False
        return len(node.args) > 1 if node.func.id in OF_SEVERAL else len(node.args) == 1
    if isinstance(node, ast.Compare):
        return len(node.ops) == 1
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        return isinstance(node.right, ast.Constant) and node.right.value in range(MAX_POWER + 1)
    return isinstance(node, (ast.Name, ast.Load, ast.BinOp, ast.UnaryOp, ast.Pow, *OPERATORS))


def _value(node: ast.AST, quantities: Mapping[str, Array]) -> Any:
    if isinstance(node, ast.Constant):
        return np.float64(cast("float", node.value))
    if isinstance(node, ast.Name):
        return quantities[node.id]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Pow):
        base, power = _value(node.left, quantities), cast("ast.Constant", node.right).value
        return reduce(operator.mul, [base] * int(cast("int", power)), np.ones_like(base))
    function, operands = _applied(node)
    return function(*(_value(operand, quantities) for operand in operands))


def _applied(node: ast.AST) -> tuple[Callable[..., Array], Sequence[ast.AST]]:
    """What is done, and to what."""
    if isinstance(node, ast.BinOp):
        return OPERATORS[type(node.op)], (node.left, node.right)
    if isinstance(node, ast.UnaryOp):
        return OPERATORS[type(node.op)], (node.operand,)
    if isinstance(node, ast.Compare):
        compared = OPERATORS[type(node.ops[0])]
        return lambda left, right: np.where(compared(left, right), 1.0, 0.0), (node.left, *node.comparators)
    call = cast("ast.Call", node)
    return FUNCTIONS[cast("ast.Name", call.func).id], call.args
