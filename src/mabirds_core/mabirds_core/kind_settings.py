"""Settings of a group's kinds as part of an experiment's: the kinds that a file names are loaded, and no other.

What a file says is checked by the model of the kind that it names. Where that refuses it, or no such kind is known, it
is checked again by all kinds of the group, whose error names the kinds that there are.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Annotated, Any

from pydantic import ValidationError
from pydantic_core import core_schema

from mabirds_core.registry import Kind, kinds, offer, union

if TYPE_CHECKING:
    from pydantic import GetCoreSchemaHandler, GetJsonSchemaHandler, TypeAdapter

Check = Callable[..., Any]
"""Takes settings, and ``strict``, whether they are checked strictly."""


def settings_of(group: str) -> Any:
    """The type of a setting that may be of any kind of a group.

    Parameters
    ----------
    group : str
        One of ``registry.GROUPS``.

    Returns
    -------
    Any
        As ``registry.union``, without loading what is not named.
    """
    return Annotated[Any, _KindSettings(group)]


@dataclass(frozen=True)
class _KindSettings:
    group: str

    def __get_pydantic_core_schema__(self, source: Any, handler: "GetCoreSchemaHandler") -> core_schema.CoreSchema:
        return core_schema.json_or_python_schema(
            json_schema=_checked_by(self._check_json),
            python_schema=_checked_by(self._check_python),
            serialization=core_schema.simple_ser_schema("any"),
        )

    def __get_pydantic_json_schema__(self, schema: core_schema.CoreSchema, handler: "GetJsonSchemaHandler") -> Any:
        return handler(_union(self.group, tuple(kinds(self.group).items())).core_schema)

    def _check_json(self, given: Any, *, strict: bool) -> Any:
        """As JSON again, so that strict types still let a list be a tuple."""
        text = json.dumps(given)
        return self._check(
            given,
            lambda model: model.model_validate_json(text, strict=strict),
            lambda adapter: adapter.validate_json(text, strict=strict),
        )

    def _check_python(self, given: Any, *, strict: bool) -> Any:
        return self._check(
            given,
            lambda model: model.model_validate(given, strict=strict),
            lambda adapter: adapter.validate_python(given, strict=strict),
        )

    def _check(self, given: Any, by_model: Callable[[Any], Any], by_union: "Callable[[TypeAdapter[Any]], Any]") -> Any:
        kind = self._named_by(given)
        if kind:
            try:
                return by_model(kind.settings)
            except ValidationError:
                pass  # told better below
        return by_union(_union(self.group, tuple(kinds(self.group).items())))

    def _named_by(self, given: Any) -> Kind | None:
        name = given.get("kind") if isinstance(given, dict) else getattr(given, "kind", None)
        found = offer(self.group, name) if isinstance(name, str) else None
        return found.kind if found else None


@cache
def _union(group: str, named: tuple[tuple[str, Kind], ...]) -> "TypeAdapter[Any]":  # noqa: ARG001 - made again for others
    from pydantic import TypeAdapter

    return TypeAdapter(union(group))


def _checked_by(check: Check) -> core_schema.CoreSchema:
    """A schema whose values are checked by a function, told whether to be strict: pydantic says so to its own alone."""

    def checked(given: Any, inner: core_schema.ValidatorFunctionWrapHandler) -> Any:
        return check(given, strict=_is_strict(inner))

    return core_schema.no_info_wrap_validator_function(checked, core_schema.int_schema())


def _is_strict(inner: core_schema.ValidatorFunctionWrapHandler) -> bool:
    """Where "1" is no number."""
    try:
        inner("1")
    except ValidationError:
        return True
    return False
