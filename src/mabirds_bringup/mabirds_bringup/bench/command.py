"""What the commands of ``mabirds bench`` have in common."""

import shlex
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mabirds_bringup.bench.cases import Case
from mabirds_bringup.bench.pool import RunCase, run_cases
from mabirds_bringup.console import console

if TYPE_CHECKING:
    import polars as pl

FIRST_SEED = 301
"""The reported seeds are 301, 302, ... where nothing else is said; none of them served to choose settings."""


@dataclass(frozen=True)
class Request:
    """What to run. ``only``: a group of cases; the others' results stay as they are in ``directory``."""

    directory: Path
    only: str | None
    seeds: int
    jobs: int
    first_seed: int = FIRST_SEED
    fresh: bool = False
    """Each case in a process of its own, so that its memory is its own."""

    def results(self, cases: Sequence[Case], run_case: RunCase) -> "pl.DataFrame":
        """Results of the cases asked for, and earlier ones of the others where only a group is asked for."""
        # The cases' processes import the whole command, and what is imported there counts as memory of the cases.
        from mabirds_bringup.bench.frame import frame_of, read_results

        self.directory.mkdir(parents=True, exist_ok=True)
        asked = [case for case in cases if self.only in {None, case.group}]
        seeds = range(self.first_seed, self.first_seed + self.seeds)
        kept = read_results(self.directory).remove(group=self.only) if self.only else frame_of([])
        return kept.extend(frame_of(run_cases(run_case, asked, seeds, self.jobs, fresh=self.fresh)))

    def tell(self, content: dict[str, Any]) -> None:
        """Which targets are met, and where the report is."""
        tell(content, self.directory)


def tell(content: dict[str, Any], directory: Path) -> None:
    """Which targets are met, and where the report is."""
    for target in content["targets"]:
        console.print(
            f"{'met   ' if target['met'] else 'MISSED'} {target['name']}: {target['value']:.4f}", soft_wrap=True
        )
    console.print(f"report in {directory / 'report.html'}", soft_wrap=True)


def command_line() -> str:
    """The command as it was typed."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])
