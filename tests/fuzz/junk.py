"""Messages that nobody should send, as hypothesis strategies: sound ones with fields spoiled, and entirely made up."""

from array import array
from collections.abc import Callable
from typing import Any

from hypothesis import strategies as st

LONG = "x" * 1000

TEXTS = st.one_of(
    st.sampled_from(
        ["", LONG, "learner_1", "learner_2", "learner_9", "expert_player", "\n\x1b[2J", "\ufffd", "\u202e"]
    ),
    st.text(max_size=80),
)
"""As the middleware hands them over: what is no UTF-8 is replaced, so that a lone surrogate cannot come."""
NUMBERS = st.sampled_from(
    [float("nan"), float("inf"), -float("inf"), 1e300, -1e300, 1.1e12, 1e12, -0.0, 0.5, 1.0, -1.0, 5e-324]
)


def whole_numbers(size: int) -> st.SearchStrategy[int]:
    """Of ``size`` bits: small ones, extremes, anything."""
    largest = 2**size - 1
    return st.one_of(
        st.integers(0, 12), st.sampled_from([largest, largest // 2, largest // 2 + 1]), st.integers(0, largest)
    )


def _of_type(name: str) -> st.SearchStrategy[Any]:
    """Values for a field of a ROS type."""
    if name.startswith("sequence<"):
        return _sequences(name.removeprefix("sequence<").removesuffix(">"))
    if name.startswith("uint"):
        return whole_numbers(int(name.removeprefix("uint")))
    if name.startswith("int"):
        size = int(name.removeprefix("int"))
        return whole_numbers(size).map(lambda number: number - 2 ** (size - 1))
    return {"string": TEXTS, "double": NUMBERS, "boolean": st.booleans()}[name]


def _sequences(element: str) -> st.SearchStrategy[Any]:
    few = st.lists(_of_type(element), max_size=12)
    codes = {"double": "d", "uint32": "I", "uint64": "Q"}
    return few.map(lambda values: array(codes[element], values)) if element in codes else few


@st.composite
def made_up(draw: st.DrawFn, kind: Callable[[], Any]) -> Any:
    """A message of any content."""
    message = kind()
    for field in message.get_fields_and_field_types():
        _fill(draw, message, field)
    return message


@st.composite
def spoiled(draw: st.DrawFn, make: Callable[[], Any]) -> Any:
    """The message that ``make`` makes with one to three fields changed, or with some numbers of an array."""
    message = make()
    for field in draw(st.lists(st.sampled_from(sorted(message.get_fields_and_field_types())), min_size=1, max_size=3)):
        values = getattr(message, field)
        if isinstance(values, array) and len(values) and draw(st.booleans()):
            places = st.integers(0, len(values) - 1)
            fill = _of_type({"d": "double", "I": "uint32", "Q": "uint64"}[values.typecode])
            for place, value in draw(st.lists(st.tuples(places, fill), max_size=4)):
                values[place] = value
            resize(values, draw(st.sampled_from([0, 0, 0, -1, 1, -len(values), 1000])))
        else:
            _fill(draw, message, field)
    return message


def spoil(message: Any, **fields: Any) -> Any:
    """The message with these fields changed."""
    for name, value in fields.items():
        setattr(message, name, value)
    return message


def resize(values: array, more: int) -> None:
    """Cut an array, or lengthen it with its last number."""
    if more < 0:
        del values[more:]
    else:
        values.extend([values[-1]] * more)


def _fill(draw: st.DrawFn, message: Any, field: str) -> None:
    value, name = getattr(message, field), message.get_fields_and_field_types()[field]
    if hasattr(value, "get_fields_and_field_types"):
        for inner in value.get_fields_and_field_types():
            _fill(draw, value, inner)
    else:
        setattr(message, field, draw(_of_type(name)))
