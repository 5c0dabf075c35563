"""Networks to be timed, and what is asked of each."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

ROOM = {"map": "...\n...", "starts": [[[0, 0], [0, 2]]], "goals": [[0, 2], [0, 0]], "horizon": 6}
"""A game that costs next to nothing, so that what is left is the exchange."""


@dataclass(frozen=True)
class ExchangeCase:
    """Learners that all hear each other.

    Attributes
    ----------
    learners : int
        How many.
    hidden : int
        Units of a neural reward, each of them some parameters in theta; 0: a linear reward.
    at_most : dict[str, float]
        Limits on what is measured, by name.
    at_least : dict[str, float]
        The same from below.
    """

    learners: int
    hidden: int = 0
    at_most: dict[str, float] = field(default_factory=dict)
    at_least: dict[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """For people."""
        return f"{self.learners} learners" + (f", {self.hidden} hidden units" if self.hidden else "")

    def settings(self, iterations: int) -> dict[str, Any]:
        """The experiment.

        Parameters
        ----------
        iterations : int
            How long.

        Returns
        -------
        dict[str, Any]
            As a file has it.
        """
        algorithm = {"reward": {"kind": "neural", "hidden": self.hidden}} if self.hidden else {}
        return {
            "name": "exchange",
            "game": ROOM,
            "algorithm": algorithm,
            "learners": [f"learner_{number + 1}" for number in range(self.learners)],
            "schedule": {"kind": "static"},
            "demonstrations": {"bag": "bag", "per_learner": iterations, "period": 1.0},
            "iterations": iterations,
        }

    def write(self, directory: Path, iterations: int) -> Path:
        """Write the experiment's file.

        Parameters
        ----------
        directory : Path
            Where.
        iterations : int
            How long.

        Returns
        -------
        Path
            The file.
        """
        file = directory / "experiment.yaml"
        file.write_text(yaml.safe_dump(self.settings(iterations)), encoding="utf-8")
        return file


RATIOS: dict[str, Any] = {
    "at_most": {"times_of_bare_processor_time": 2.0, "times_without_checkpoints": 1.5},
    "at_least": {"share_of_bare_rate": 0.5},
}
CASES = (ExchangeCase(2, **RATIOS), ExchangeCase(4, **RATIOS), ExchangeCase(8, **RATIOS))
LARGE = (ExchangeCase(2, 1_000), ExchangeCase(2, 10_000))
"""Of 1e4 and 1e5 numbers in theta: told, without a target."""

SMALL = (ExchangeCase(2, at_most={"times_of_bare_processor_time": 4.0}, at_least={"share_of_bare_rate": 0.2}),)
"""Ratios that hold on any machine, however busy."""
