"""What `mabirds inspect` shows in a terminal: players, learners, edges, distances, costs. It fits 60 columns."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from rich.columns import Columns
from rich.console import Group
from rich.table import Table
from rich.text import Text

from mabirds_bringup.draw.colours import EDGES
from mabirds_bringup.watch.cost_map import cost_map
from mabirds_bringup.watch.described import describe
from mabirds_bringup.watch.edges import edge_states
from mabirds_bringup.watch.eta import eta_text, remaining
from mabirds_bringup.watch.inspector import InspectorNode, WatchedLearner
from mabirds_bringup.watch.player_words import player_words
from mabirds_bringup.watch.recent import Consensus, RecentParameters
from mabirds_core.texts import sanitize

STATES = {
    "waits for a demonstration": "no demo",
    "waits for neighbours": "waits",
    "learning": "learns",
    "finished": "finished",
}
"""Few letters for a narrow table."""

MAPS = 8
"""Cost maps that are shown, at most."""


def overview(node: InspectorNode, recent: RecentParameters, maps: Mapping[str, Any]) -> Group:
    """Everything that is known just now.

    Parameters
    ----------
    node : InspectorNode
        That has heard it.
    recent : RecentParameters
        Of all learners.
    maps : Mapping[str, Any]
        Grids of costs by topic, where somebody draws them.

    Returns
    -------
    Group
        For rich.
    """
    learners = [learner for _, learner in sorted(node.learners.items())]
    totals = demonstrations_of(node)
    parts: list[Any] = [Text(line) for line in player_lines(node)]
    parts.append(learner_table(learners, totals))
    parts += [Text(sanitize(line)) for line in waiting_lines(learners)]
    parts += [edge_line(learners), Text(consensus_line(recent.consensus(), learners))]
    if maps:
        parts.append(Columns([f"{_short(topic)}\n{cost_map(grid)}" for topic, grid in sorted(maps.items())[:MAPS]]))
    return Group(*(part for part in parts if part))


def demonstrations_of(node: InspectorNode) -> dict[str, int]:
    """How many demonstrations each learner is to get, by what players say."""
    heard = [status for status in node.players.values() if status is not None]
    return {name: int(total) for status in heard for name, total in zip(status.learners, status.total, strict=False)}


def player_lines(node: InspectorNode) -> Iterator[str]:
    """One line for each player: state, rate, how far, how long still."""
    for topic, status in sorted(node.players.items()):
        if status is not None:
            yield f"player {_short(topic)}: {player_words(status)}"
    if not node.players:
        yield "no player"


def learner_table(learners: list[WatchedLearner], totals: Mapping[str, int]) -> Table:
    """A row for each learner, in columns whose widths do not change with what is in them."""
    table = Table(box=None, padding=(0, 1, 0, 0), pad_edge=False)
    for column, width, side in (
        ("learner", 12, "left"),
        ("state", 8, "left"),
        ("learned", 9, "right"),
        ("it/s", 6, "right"),
        ("ETA", 5, "right"),
        ("queue", 5, "right"),
        ("drops", 5, "right"),
    ):
        table.add_column(column, width=width, justify=side, no_wrap=True, overflow="ellipsis")  # type: ignore[arg-type]
    for learner in learners:
        table.add_row(*row(learner, totals.get(learner.name)))
    return table


def row(learner: WatchedLearner, total: int | None) -> list[str]:
    """Cells of a learner."""
    content = describe(learner, 0)
    if "state" not in content:
        return [sanitize(learner.name), "silent", "", "", "", "", ""]
    done = int(content["last_demonstration"])
    left = remaining(done, total, learner.rate) if total is not None else None
    return [
        sanitize(learner.name),
        STATES.get(content["state"], content["state"]),
        f"{done}/{total}" if total is not None else str(done),
        "" if learner.rate is None else f"{learner.rate:.3g}",
        eta_text(left),
        str(content["backlog"]),
        str(sum(content["dropped"].values())),
    ]


def waiting_lines(learners: list[WatchedLearner]) -> Iterator[str]:
    """Who waits for whom, and the newest event of each."""
    for learner in learners:
        status = learner.status
        if status is not None and status.waiting_for:
            yield f"{learner.name} waits for {', '.join(status.waiting_for)} (iteration {status.iteration})"
        if status is not None and status.message:
            yield f"{learner.name}: {status.message}"


def edge_line(learners: list[WatchedLearner]) -> Text:
    """The edges of the present slot that are open, in the colours of their states."""
    schedule = next((learner.edges for learner in learners if learner.edges is not None), None)
    if schedule is None:
        return Text("")
    line = Text("edges: ")
    states = edge_states(schedule, {learner.name: learner.status for learner in learners})
    opened = {edge: state for edge, state in states.items() if state != "closed"}
    for (sender, receiver), edge_state in opened.items():
        ends = f"{sanitize(schedule.learners[sender])}→{sanitize(schedule.learners[receiver])}"
        line.append(f"{ends} {edge_state}  ", style=EDGES[edge_state])
    line.append(f"({len(states) - len(opened)} closed)")
    return line


def consensus_line(consensus: Consensus | None, learners: list[WatchedLearner]) -> str:
    """How far learners are apart, relative to how large their parameters are."""
    return consensus_words(consensus, [describe(learner, 0) for learner in learners])


def consensus_words(consensus: Consensus | None, contents: Sequence[Mapping[str, Any]]) -> str:
    """The same of learners that are described already."""
    if consensus is None:
        return ""
    norms = [content["parameters"] for content in contents if "parameters" in content]
    words = []
    for part, distance in (("theta", consensus.theta), ("omega", consensus.omega)):
        largest = max((of_one[f"{part}_norm"] for of_one in norms), default=0.0)
        share = f" ({100 * distance / largest:.2g}% of its norm)" if largest > 0 else ""
        words.append(f"{part} {distance:.3g}{share}")
    return f"apart at iteration {consensus.iteration}: {', '.join(words)}"


def _short(topic: str) -> str:
    return sanitize(topic.removesuffix("/player_status").replace("/drawn/costs/", " ").strip("/"))
