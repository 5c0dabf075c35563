"""The table that `mabirds run` shows while it runs: who is where, and who waits for whom."""

from mabirds_msgs.msg import LearnerStatus
from rich.table import Table

from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import Experiment
from mabirds_core.texts import sanitize

STATES = {
    LearnerStatus.WAITING_FOR_DEMONSTRATION: "waits for a demonstration",
    LearnerStatus.WAITING_FOR_NEIGHBOURS: "waits for neighbours",
    LearnerStatus.LEARNING: "learning",
    LearnerStatus.FINISHED: "finished",
}


def live_table(experiment: Experiment, monitor: MonitorNode, left: str = "") -> Table:
    """One row per learner, the consensus distance and what is ``left`` below.

    s: seconds of its newest iteration. nats: log likelihood of its newest demonstration before it was learned.
    """
    table = Table(
        title=f"{experiment.name}: {len(monitor.names)} learning",
        caption="; ".join(filter(None, [caption(monitor), left])),
    )
    for column in ("learner", "learned", "backlog", "state", "waits for", "s", "nats", "dropped"):
        table.add_column(column)
    for name in monitor.names:
        table.add_row(name, *_cells(experiment, monitor, name))
    return table


def _cells(experiment: Experiment, monitor: MonitorNode, name: str) -> list[str]:
    status = monitor.statuses.get(name)
    if status is None:
        return ["-", "-", "starting", "", "", "", ""]
    metrics = dict(zip(status.metric_names, status.metric_values, strict=False))
    drops = dict(zip(status.drop_reasons, status.drop_counts, strict=False))
    cells = (
        f"{status.last_demonstration}/{experiment.iterations}",
        str(status.backlog),
        _state(monitor, name, status),
        f"{', '.join(status.waiting_for)} (iteration {status.iteration})" if status.waiting_for else "",
        _number(metrics.get("iteration_seconds"), ".3f"),
        _number(metrics.get("held_out_log_likelihood"), ".1f"),
        ", ".join(f"{reason} {count}" for reason, count in drops.items()),
    )
    return [sanitize(cell) for cell in cells]  # whatever others have put into their statuses


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
    cells = (_cells(experiment, monitor, name) for name in monitor.names)
    rows = [f"{name} {row[0]} {row[2]} {row[3]}".rstrip() for name, row in zip(monitor.names, cells, strict=True)]
    return "; ".join([*rows, caption(monitor)])
