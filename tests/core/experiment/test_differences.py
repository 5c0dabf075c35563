"""The setting that differs is named, whatever others say."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from mabirds_core.experiment.differences import MOST, differences, settings_lines
from mabirds_core.experiment.file import load_experiment

Make = Callable[..., Path]


def lines(make: Make, name: str, run: str = "", **change: Any) -> list[str]:
    return settings_lines(load_experiment(make(name=name, change=change)), run)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"seed": 4}, "seed is 4 there and 3 here"),
        ({"closing_rounds": 2}, "closing_rounds is 2 there and at its default here"),
        ({"run": "tuesday"}, 'run is "tuesday" there and "monday" here'),
        ({"schedule": {"kind": "directed_ring"}}, 'schedule.kind is "directed_ring" there and "static" here'),
        ({"constraint_threshold": 0.2}, ""),  # decides nothing on the network
        ({"algorithm": {"steps": {"alpha": 8.0, "beta": 5.0}, "rollouts": 20}}, "algorithm.steps.beta is 5.0 there"),
    ],
)
def test_each_kind_of_difference(make_experiment: Make, change: dict[str, Any], words: str) -> None:
    theirs = lines(make_experiment, "theirs", **{"run": "monday", **change})
    found = differences(theirs, lines(make_experiment, "ours", run="monday"))
    assert found.startswith(words)
    assert (found == "") == (words == "")


def test_lies_of_others_are_short_and_on_one_line() -> None:
    found = differences(["\n" * 1000, *(f"{n} = {'x' * 1000}" for n in range(1000))], [])
    assert len(found) < 200 * (MOST + 1)
    assert found.isprintable()
    assert found.endswith("996 more")
