"""Messages of any type as plain values, and back."""

import importlib
import math
from array import array
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np

from mabirds_core.errors import MabirdsError
from mabirds_core.experiment.names import ParameterNames


class InspectionError(MabirdsError):
    """What was asked for is not there, or has another type."""


def message_type(name: str) -> Any:
    """The class of a message or service such as "nav_msgs/msg/Path".

    Raises
    ------
    InspectionError
        It is not installed here.
    """
    package, kind, last = (*name.split("/"), "", "")[:3]
    try:
        return getattr(importlib.import_module(f"{package}.{kind}"), last)
    except (ImportError, AttributeError, ValueError):
        raise InspectionError(f"type {name}: not installed on this host; install the package {package}") from None


def plain(value: Any) -> Any:
    """A message, or part of one, as dictionaries, lists and numbers that JSON knows; NaN and infinity are None."""
    if hasattr(value, "get_fields_and_field_types"):
        return {name: plain(getattr(value, name)) for name in value.get_fields_and_field_types()}
    if isinstance(value, bytes):
        return list(value)
    if isinstance(value, np.generic):
        return plain(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, str | int | bool):
        return value
    return [plain(each) for each in value]


def named(content: dict[str, Any], names: ParameterNames) -> dict[str, Any]:
    """Parameters with theta and omega by name, where there is a name for each."""
    by_name = {}
    for part, of_part in names._asdict().items():
        values = content.get(part)
        if isinstance(values, list) and of_part and len(values) == len(of_part):
            by_name[part] = dict(zip(of_part, values, strict=True))
    return {**content, **by_name}


def field_of(content: Any, field: str) -> Any:
    """Part of plain values by a path such as "pose.position.x", "metric_values.0" or "omega.sharing a cell".

    Raises
    ------
    InspectionError
        There is none of this name.
    """
    for name in field.split(".") if field else ():
        if isinstance(content, Mapping) and name in content:
            content = content[name]
        elif isinstance(content, list) and name.isdecimal() and int(name) < len(content):
            content = content[int(name)]
        else:
            has = ", ".join(list(content)[:12]) if isinstance(content, Mapping) else f"no part {name!r}"
            raise InspectionError(f"field {field}: there is no {name!r} here; it has {has}")
    return content


def flat(content: Any, prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Every value that has no parts, with its path."""
    if not isinstance(content, Mapping | list):
        yield prefix, content
        return
    for name, value in content.items() if isinstance(content, Mapping) else enumerate(content):
        yield from flat(value, f"{prefix}.{name}" if prefix else str(name))


def fill(message: Any, content: Any) -> Any:
    """Set fields of a message from plain values, and return it.

    Raises
    ------
    InspectionError
        A field is not there, or takes no such value.
    """
    if not isinstance(content, Mapping):
        raise InspectionError(f"{content!r}: expected fields such as '{{rate: 2.0}}'")
    fields = message.get_fields_and_field_types()
    for name, value in content.items():
        if name not in fields:
            raise InspectionError(f"field {name}: expected one of {', '.join(fields) or 'none'}")
        current = getattr(message, name)
        if hasattr(current, "get_fields_and_field_types"):
            fill(current, value)
            continue
        try:
            setattr(message, name, _fitting(current, value))
        except (AssertionError, TypeError, ValueError, OverflowError):
            raise InspectionError(f"field {name}: {value!r} is no {fields[name]}") from None
    return message


def _fitting(current: Any, value: Any) -> Any:
    """The value as a field takes it that holds ``current``; raises TypeError for one of another kind."""
    if isinstance(current, array):
        return array(current.typecode, value)
    kinds = {bool: bool, int: int, float: (int, float), str: str, list: list}
    kind = kinds.get(type(current), list)
    if not isinstance(value, kind) or (isinstance(value, bool) and not isinstance(current, bool)):  # type: ignore[arg-type]
        raise TypeError
    return float(value) if isinstance(current, float) else value
