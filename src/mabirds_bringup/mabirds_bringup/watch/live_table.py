"""The table that `mabirds run` shows while it runs: who is where, who waits for whom, and how long it takes."""

import time
from collections import defaultdict, deque
from collections.abc import Callable, Iterator

from mabirds_msgs.msg import LearnerStatus
from rich.console import Group
from rich.table import Table
from rich.text import Text

from mabirds_bringup.watch.eta import eta_text, remaining
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_bringup.watch.player_words import player_words
from mabirds_core.experiment.file import Experiment
from mabirds_core.texts import sanitize

STATES = {
    LearnerStatus.WAITING_FOR_DEMONSTRATION: "waits for a demonstration",
    LearnerStatus.WAITING_FOR_NEIGHBOURS: "waits for neighbours",
    LearnerStatus.LEARNING: "learning",
    LearnerStatus.FINISHED: "finished",
}

COLUMNS = (
    ("learner", 12, "left"),
    ("learned", 9, "right"),
    ("state", 8, "left"),
    ("ETA", 5, "right"),
    ("queue", 5, "right"),
    ("s", 6, "right"),
    ("nats", 7, "right"),
)
"""Names, widths and sides: with a blank between two of them 58 columns, whatever is in them."""

WINDOW = 40
"""Looks of which the pace is told."""


class Pace:
    """How fast each learner learns, from when it was seen where.

    Parameters
    ----------
    clock : Callable[[], float], optional
        Seconds that only grow.
    """

    def __init__(self, clock: Callable[[], float] = time.monotonic) -> None:
        self._clock = clock
        self._seen: defaultdict[str, deque[tuple[float, int]]] = defaultdict(lambda: deque(maxlen=WINDOW))

    def note(self, monitor: MonitorNode) -> None:
        """Take a look."""
        for name, status in monitor.statuses.items():
            self._seen[name].append((self._clock(), int(status.last_demonstration)))

    def eta(self, name: str, total: int) -> str:
        """How long a learner still needs, in words; empty where that cannot be told."""
        return eta_text(self._left(name, total))

    def slowest(self, total: int) -> str:
        """How long the slowest learner that moves still needs, in words; empty where that cannot be told."""
        known = [left for name in self._seen if (left := self._left(name, total)) is not None]
        return eta_text(max(known, default=None))

    def _left(self, name: str, total: int) -> float | None:
        seen = self._seen[name]
        if not seen or seen[-1][1] >= total:
            return None
        (begun, first), (ended, last) = seen[0], seen[-1]
        rate = (last - first) / (ended - begun) if ended > begun else None
        return remaining(last, total, rate)


def live_table(experiment: Experiment, monitor: MonitorNode, pace: Pace) -> Group:
    """The player, one row per learner, who waits and what was dropped, and the consensus distance; 60 columns.

    s: seconds of its newest iteration. nats: log likelihood of its newest demonstration before it was learned.
    """
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for column, width, side in COLUMNS:
        table.add_column(column, width=width, justify=side, no_wrap=True, overflow="ellipsis")  # type: ignore[arg-type]
    for name in monitor.names:
        table.add_row(*_cells(experiment, monitor, pace, name))
    lines = [Text(line) for line in _lines(monitor)]
    title = Text(sanitize(f"{experiment.name}: {len(monitor.names)} learning; {_player(monitor)}"))
    return Group(title, table, *lines, Text(caption(monitor)))


def _player(monitor: MonitorNode) -> str:
    return "no player heard" if monitor.player is None else f"player {player_words(monitor.player)}"


def _cells(experiment: Experiment, monitor: MonitorNode, pace: Pace, name: str) -> list[str]:
    status = monitor.statuses.get(name)
    if status is None:
        return [name, "-", "starting", "", "-", "", ""]
    metrics = dict(zip(status.metric_names, status.metric_values, strict=False))
    return [
        name,
        f"{status.last_demonstration}/{experiment.iterations}",
        sanitize(_state(monitor, name, status)),
        pace.eta(name, experiment.iterations),
        str(status.backlog),
        _number(metrics.get("iteration_seconds"), ".3f"),
        _number(metrics.get("held_out_log_likelihood"), ".1f"),
    ]


def _lines(monitor: MonitorNode) -> Iterator[str]:
    """For whom learners wait, and what they dropped."""
    for name in monitor.names:
        if (status := monitor.statuses.get(name)) is not None:
            words = [*_waits(status), *_drops(status)]
            if words:
                yield sanitize(f"{name}: {'; '.join(words)}")


def _waits(status: LearnerStatus) -> list[str]:
    return [f"waits for {', '.join(status.waiting_for)} (iteration {status.iteration})"] if status.waiting_for else []


def _drops(status: LearnerStatus) -> list[str]:
    drops = zip(status.drop_reasons, status.drop_counts, strict=False)
    told = ", ".join(f"{reason} {count}" for reason, count in drops)
    return [f"dropped {told}"] if told else []


def _number(value: float | None, form: str) -> str:
    return "" if value is None else format(value, form)


def _state(monitor: MonitorNode, name: str, status: LearnerStatus) -> str:
    if monitor.presence.is_lost(name):
        return "gone"
    return "waiting" if status.waiting_for else STATES.get(status.state, f"state {status.state}?")


def caption(monitor: MonitorNode) -> str:
    """The consensus distances in words."""
    consensus = monitor.consensus()
    if consensus is None:
        return "no parameters yet"
    return f"iteration {consensus[0]}: consensus distance theta {consensus[1]:.3g}, omega {consensus[2]:.3g}"


def plain_line(experiment: Experiment, monitor: MonitorNode) -> str:
    """The same in one line, for output that is not a terminal."""
    return "; ".join(
        [*(_plain(experiment, monitor, name) for name in monitor.names), _player(monitor), caption(monitor)]
    )


def _plain(experiment: Experiment, monitor: MonitorNode, name: str) -> str:
    status = monitor.statuses.get(name)
    if status is None:
        return f"{name} - starting"
    waits = f" {', '.join(status.waiting_for)} (iteration {status.iteration})" if status.waiting_for else ""
    return sanitize(
        f"{name} {status.last_demonstration}/{experiment.iterations} {_state(monitor, name, status)}{waits}"
    )
