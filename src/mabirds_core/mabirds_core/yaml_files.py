"""YAML files that somebody else may have written: read in bounded time and memory, refused with one kind of error."""

from collections import Counter
from pathlib import Path
from typing import Any

import yaml

from mabirds_core.texts import truncate

MAX_FILE = 2**20
"""Bytes of a file: some seconds of reading, and a few hundred megabytes, where every second byte is a setting."""

MAX_MERGED = 100_000
"""Settings that the merge keys of a file may stand for."""

MAX_ERROR = 1000
"""Characters of an error."""

FAILURES = (yaml.YAMLError, RecursionError, ValueError, LookupError, AttributeError, TypeError, OverflowError)
"""What PyYAML raises for text that is no YAML: its own errors, and those of numbers, dates and keys that are none."""


def read_yaml(path: Path) -> Any:
    """The content of a file.

    Raises
    ------
    OSError
        It cannot be read.
    ValueError
        It is no YAML, or too large.
    """
    with path.open("rb") as stream:
        content = stream.read(MAX_FILE + 1)
    if len(content) > MAX_FILE:
        raise ValueError(f"it has more than {MAX_FILE} bytes")
    try:
        return yaml.load(content.decode(), Loader=_Loader)  # noqa: S506 - a SafeLoader
    except FAILURES as error:
        raise ValueError(truncate(str(error), MAX_ERROR)) from None


class _Loader(yaml.SafeLoader):
    """A setting that is written twice is an error, instead of the second silently winning."""

    merged = 0

    def construct_mapping(self, node: yaml.MappingNode, deep: bool = False) -> dict[Any, Any]:  # noqa: FBT001, FBT002
        keys = Counter(self.construct_object(key, deep=True) for key, _ in node.value if not _merges(key))
        for key, count in keys.items():
            if count > 1:
                raise _refusal(node, f"{key!r} is set twice")
        return super().construct_mapping(node, deep)

    def flatten_mapping(self, node: yaml.MappingNode) -> None:
        """Put in what ``<<`` names, one mapping each time: lists of lists of aliases can stand for gigabytes."""
        merges = [value for key, value in node.value if _merges(key)]
        if len(merges) > 1 or not all(isinstance(value, yaml.MappingNode) for value in merges):
            raise _refusal(node, "<<: expected one mapping")
        super().flatten_mapping(node)
        self.merged += len(node.value) if merges else 0
        if self.merged > MAX_MERGED:
            raise _refusal(node, f"its merge keys stand for more than {MAX_MERGED} settings")


def _merges(key: yaml.Node) -> bool:
    return key.tag.endswith(":merge")


def _refusal(node: yaml.Node, text: str) -> yaml.constructor.ConstructorError:
    return yaml.constructor.ConstructorError(None, None, text, node.start_mark)
