"""What a benchmark is to show, and whether it does."""

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any

COLUMNS = ("", "value", "target", "")


@dataclass(frozen=True)
class Target:
    """A figure and its limit."""

    name: str
    value: float
    target: float
    at_most: bool

    @property
    def met(self) -> bool:
        """Is the value on the right side of its limit?"""
        return self.value <= self.target if self.at_most else self.value >= self.target

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {**asdict(self), "met": self.met}


def target_lines(targets: Iterable[Target]) -> list[list[str]]:
    """Lines of a table below ``COLUMNS``."""
    return [
        [
            one.name,
            f"{one.value:.3f}",
            f"{'<=' if one.at_most else '>='} {one.target:g}",
            "met" if one.met else "missed",
        ]
        for one in targets
    ]
