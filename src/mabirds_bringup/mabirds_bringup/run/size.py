"""How much memory and time an iteration takes, told before anything starts.

Where experts walk on a map, a solve passes over all states at all times, and over the ways in the few states where the
experts' moves are coupled: seconds = T (a S N_E + b K), bytes = 24 T S + 71 K. a and b are measured here and now, on
two small maps that take some milliseconds; bytes are those of the arrays that a solve allocates.
"""

import os
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from mabirds_bringup.bench.solve.cases import SolveCase, weights
from mabirds_bringup.bench.solve.solving import fastest, solve
from mabirds_bringup.console import console
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import Experiment

A_STATE, A_WAY = 24.0, 71.0
"""Bytes of a state at a time, and of a coupled way."""

PROCESS = 110.0
"""Megabytes of a learner's process, whatever it learns."""

MEGABYTE = 1e6

MOST_STATES = 10**8
"""States beyond which ways are not counted: that would take what is to be told."""


@dataclass(frozen=True)
class Size:
    """Of one learner's iteration.

    ``states``: S. ``actions``: joint ones. ``horizon``: T. ``megabytes``: beside those of its process. ``seconds``: of
    one processor.
    """

    states: int
    actions: int
    horizon: int
    megabytes: float
    seconds: float

    @property
    def content(self) -> dict[str, Any]:
        """For JSON."""
        return asdict(self)


class Rates(NamedTuple):
    """Seconds of a state, a time and an expert, and of a coupled way and a time, on this machine."""

    a_state: float
    a_way: float


@cache
def measured_rates() -> Rates:
    """Solve two small games, some milliseconds each."""
    seconds, terms = list[float](), list[tuple[float, float]]()
    for side, experts in ((8, 2), (4, 3)):
        game = SolveCase(side, experts, 10).game
        work = partial(solve, game, *weights(game))
        work()  # what is made once for all
        seconds.append(1e-3 * fastest(work, 0.03, 10))
        terms.append((10.0 * game.n_states * experts, 10.0 * _ways(game)))
    a_state, a_way = np.linalg.solve(np.array(terms), np.array(seconds))
    return Rates(max(float(a_state), 0.0), max(float(a_way), 0.0))


def _ways(game: Any) -> int:
    return int((game.factors.coupled_levels > 0).sum())


def size_of(experiment: Experiment) -> Size | None:
    """Estimate what an iteration takes; None of games whose experts do not walk from cell to cell on their own."""
    game = build_game(experiment)
    return estimate(game) if hasattr(game, "factors") else None


def estimate(game: Any) -> Size:
    """Estimate what an iteration takes in a game with ``factors``."""
    states, times = int(game.n_states), int(game.horizon) + 1
    ways, rates = _ways(game) if states <= MOST_STATES else 0, measured_rates()
    bytes_ = A_STATE * states * times + A_WAY * ways
    seconds = times * (rates.a_state * states * game.n_experts + rates.a_way * ways)
    return Size(states, int(game.n_actions), int(game.horizon), bytes_ / MEGABYTE, seconds)


def available_megabytes() -> float | None:
    """What processes can still have on this host; None where the system does not say."""
    try:
        lines = Path("/proc/meminfo").read_text(encoding="ascii").splitlines()
    except OSError:
        return None
    return next((float(line.split()[1]) / 1e3 for line in lines if line.startswith("MemAvailable")), None)


def shown_size(experiment: Experiment, processes: int) -> Size | None:
    """Tell the size of an experiment and warn where it may not fit; ``processes``: that learn on this host."""
    size = size_of(experiment)
    if size is not None:
        console.print(told(size, experiment, processes), soft_wrap=True)
        if words := warning(size, processes, available_megabytes()):
            console.print(f"warning: {words}", style="yellow", soft_wrap=True)
    return size


def told(size: Size, experiment: Experiment, learners: int) -> str:
    """The estimate in words, with ``learners`` of the experiment on this host."""
    each = -(-learners // (os.cpu_count() or 1)) * size.seconds
    return (
        f"{size.states:,} states, {size.actions} joint actions, horizon {size.horizon}: about {_time(size.seconds)} and"
        f" {size.megabytes:,.0f} MB for an iteration of a learner, {_time(each * experiment.iterations)} for"
        f" {experiment.iterations} iterations"
    )


def warning(size: Size, processes: int, available: float | None) -> str | None:
    """Why it may not fit into the memory of this host, and what helps; None where it does."""
    needed = processes * (size.megabytes + PROCESS)
    if available is None or needed <= available:
        return None
    return (
        f"{needed:,.0f} MB are needed for {processes} learning processes, {available:,.0f} MB are free: take a smaller"
        " map, a shorter horizon or fewer experts, or spread the learners over hosts (--only)"
    )


def _time(seconds: float) -> str:
    if seconds < 1.0:
        return f"{1e3 * seconds:.1f} ms"
    return f"{seconds:.3g} s" if seconds < 120.0 else f"{seconds / 60.0:.3g} min"
