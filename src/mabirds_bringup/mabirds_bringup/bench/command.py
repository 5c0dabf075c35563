"""What the commands of ``mabirds bench`` have in common."""

import shlex
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.pool import run_cases
from mabirds_bringup.bench.report import earlier_outcomes
from mabirds_bringup.bench.tables import Named
from mabirds_bringup.console import console

FIRST_SEED = 301
"""The reported seeds are 301, 302, ... where nothing else is said; none of them served to choose settings."""

Outcome = TypeVar("Outcome", bound=Named)


@dataclass(frozen=True)
class Request:
    """What to run. ``only``: a group of cases; the others' outcomes stay as they are in ``directory``."""

    directory: Path
    only: str | None
    seeds: int
    jobs: int
    first_seed: int = FIRST_SEED
    fresh: bool = False
    """Each case in a process of its own, so that its memory is its own."""

    def outcomes(
        self, cases: Sequence[Case], run_case: Callable[[Case, int], list[Outcome]], make: Callable[..., Outcome]
    ) -> list[Outcome]:
        """Of the cases asked for, and of earlier ones; ``make`` makes those from what was written."""
        self.directory.mkdir(parents=True, exist_ok=True)
        asked = [case for case in cases if self.only in {None, case.group}]
        kept = [one for one in earlier_outcomes(self.directory, make) if one.group != self.only] if self.only else []
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        return [*kept, *run_cases(run_case, asked, seeds, self.jobs, fresh=self.fresh)]

    def tell(self, content: dict[str, Any]) -> None:
        """Which targets are met, and where the report is."""
        for target in content["targets"]:
            console.print(
                f"{'met   ' if target['met'] else 'MISSED'} {target['name']}: {target['value']:.4f}", soft_wrap=True
            )
        console.print(f"report in {self.directory / 'report.html'}", soft_wrap=True)


def command_line() -> str:
    """What was typed."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
