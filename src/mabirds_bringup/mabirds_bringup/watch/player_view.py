"""How a player stands, for people: a bar, a line."""

from typing import Any

from mabirds_msgs.msg import PlayerStatus
from rich.console import Group
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from mabirds_core.texts import sanitize
from mabirds_msgs_py.conversion import NANOSECONDS, nanoseconds

KEYS = "space pause, right next, up/down rate, left/f seek 10 s back/on, q stop"


def played_seconds(status: PlayerStatus) -> tuple[float, float]:
    """Recorded seconds from the beginning to where the player is, and to the end."""
    first, at, last = (nanoseconds(time) for time in (status.first, status.at, status.last))
    return (at - first) / NANOSECONDS, (last - first) / NANOSECONDS


def state(status: PlayerStatus) -> str:
    """What the player does, in a word."""
    if not status.playing:
        return "finished"
    return "paused" if status.paused else "playing"


def speed(status: PlayerStatus) -> str:
    """How fast it plays."""
    return f"{status.hz:g} Hz" if status.hz > 0 else f"{status.rate:.4g}x"


def line(status: PlayerStatus) -> str:
    """All of it in one line."""
    at, end = played_seconds(status)
    parts = [f"{state(status)} {speed(status)}, {at:.1f} of {end:.1f} s", *_learners(status)]
    if status.loops != 1:
        parts.append(f"round {status.loop} of {status.loops or 'many'}")
    if status.waiting:
        parts.append(f"waits: {sanitize(status.waiting)}")
    return "; ".join(parts)


def _learners(status: PlayerStatus) -> list[str]:
    rows = zip(status.learners, status.sent, status.total, status.acknowledged, status.consumes, strict=True)
    return [
        f"{sanitize(name)} {sent}/{total}{f', learned {learned}' if consumes else ''}"
        for name, sent, total, learned, consumes in rows
    ]


def bar(status: PlayerStatus, *, keys: bool) -> Group:
    """The bar, with the line below it."""
    at, end = played_seconds(status)
    progress = Table.grid(padding=(0, 1))
    progress.add_row(
        Text(state(status)), ProgressBar(total=max(end, 1e-9), completed=at, width=40), Text(speed(status))
    )
    return Group(progress, Text(line(status)), *([Text(KEYS, style="dim")] if keys else []))


def content(status: PlayerStatus) -> dict[str, Any]:
    """All of it for programs."""
    at, end = played_seconds(status)
    learners = {
        name: {"sent": int(sent), "total": int(total), "learned": int(learned), "consumes": bool(consumes)}
        for name, sent, total, learned, consumes in zip(
            status.learners, status.sent, status.total, status.acknowledged, status.consumes, strict=True
        )
    }
    return {
        "state": state(status),
        "rate": status.rate,
        "hz": status.hz,
        "seconds": at,
        "total_seconds": end,
        "loop": status.loop,
        "loops": status.loops,
        "learners": learners,
        "waiting": status.waiting,
        "answer": status.answer,
    }
