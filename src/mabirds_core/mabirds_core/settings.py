"""What all settings of an experiment file have in common."""

from collections.abc import Mapping
from typing import ClassVar

from pydantic import BaseModel, ConfigDict


class Settings(BaseModel):
    """Checked when read, never changed after; a misspelt name or a number that is none is an error.

    What checks them is made when they are first read: an experiment has no use for most of the settings that there are.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False, defer_build=True)

    renamed: ClassVar[Mapping[str, str]] = {}
    """Settings by the names that they had in versions before, with their names of today."""


def renamed_settings() -> dict[str, str]:
    """``renamed`` of all settings that are loaded."""
    return {old: new for settings in Settings.__subclasses__() for old, new in settings.renamed.items()}
