"""The graph as it was delivered: what became of each edge at each iteration, as a picture."""

from collections import Counter
from collections.abc import Mapping

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from mabirds_bringup.draw.colours import EDGES
from mabirds_bringup.report.said import Edge
from mabirds_core.consensus.schedule import DeliveredEdges, EdgeSchedule, delivered_edges

STATES = ("closed", "delivered", "unknown", "late", "missed")
"""Of an edge at an iteration, in the order of how much they matter where there is room for one only."""

MOST_EDGES, MOST_COLUMNS = 40, 800
"""Rows and columns of the picture, at most."""

LATE = 0.1
"""Seconds of waiting from which on an edge is late: learners that take turns wait a little, always."""

WORDS = {
    "delivered": "delivered: mixed in by its receiver",
    "late": f"late: its receiver waited longer than {LATE:g} s, or got it outside its slot",
    "missed": "missed: its receiver went on without it",
    "closed": "closed: not in this slot of the schedule",
    "unknown": "unknown: its receiver was not heard of",
}

States = NDArray[np.int8]
"""Indices of STATES, shape (edges, iterations)."""


def delivery(
    schedule: EdgeSchedule, delivered: DeliveredEdges, waits: Mapping[Edge, float], iterations: int
) -> tuple[list[str], States]:
    """What became of each edge.

    Parameters
    ----------
    schedule : EdgeSchedule
        E(n).
    delivered : DeliveredEdges
        Whose parameters each learner mixed, by iteration.
    waits : Mapping[Edge, float]
        Seconds for which receivers waited, by iteration, sender and receiver.
    iterations : int
        Of the run.

    Returns
    -------
    tuple[list[str], States]
        Names of edges, and their states.
    """
    passed = {n: delivered_edges(schedule, senders) for n, senders in delivered.items()}
    edges = sorted({*schedule.all_edges, *(edge for some in passed.values() for edge in some)})
    states = np.full((len(edges), iterations), STATES.index("unknown"), dtype=np.int8)
    for n in (n for n in passed if n <= iterations):
        for row, (sender, receiver) in enumerate(edges):
            is_open, mixed = (sender, receiver) in schedule.edges(n), (sender, receiver) in passed[n]
            late = waits.get((n, schedule.learners[sender], schedule.learners[receiver]), 0.0) > LATE
            states[row, n - 1] = STATES.index(_state(is_open=is_open, mixed=mixed, late=late))
    return [f"{schedule.learners[sender]} → {schedule.learners[receiver]}" for sender, receiver in edges], states


def _state(*, is_open: bool, mixed: bool, late: bool) -> str:
    if not mixed:
        return "missed" if is_open else "closed"
    return "delivered" if is_open and not late else "late"


def delivery_figure(names: list[str], states: States) -> Figure:
    """A row for each edge, a column for each iteration.

    Parameters
    ----------
    names : list[str]
        Of edges.
    states : States
        As of ``delivery``.

    Returns
    -------
    Figure
        With a legend beside it.
    """
    counts = Counter(STATES[state] for state in states.ravel())
    rows = np.sort(np.argsort(-np.sum(states >= STATES.index("late"), axis=1), kind="stable")[:MOST_EDGES])
    figure, axis = plt.subplots(figsize=(11, 1.3 + 0.3 * len(rows)), layout="constrained")
    colours = ListedColormap([EDGES[state] for state in STATES])
    shown = np.arange(1, states.shape[1] + 1)
    axis.imshow(
        coarser(states[rows]),
        cmap=colours,
        vmin=-0.5,
        vmax=len(STATES) - 0.5,
        aspect="auto",
        interpolation="nearest",
        extent=(shown[0] - 0.5, shown[-1] + 0.5, len(rows) - 0.5, -0.5),
    )
    axis.set_yticks(range(len(rows)), [names[row] for row in rows], fontsize=7)
    axis.hlines(np.arange(1, len(rows)) - 0.5, 0.5, shown[-1] + 0.5, color="white", lw=2)
    axis.xaxis.set_major_locator(MaxNLocator(integer=True))
    axis.set(xlabel="iteration", title=title(counts))
    axis.title.set_fontsize(10)
    if len(rows) < len(names):
        axis.set_ylabel(f"the {len(rows)} most troubled of {len(names)} edges", fontsize=7)
    _legend(axis, counts)
    return figure


def title(counts: Counter[str]) -> str:
    """What the picture shows, in a sentence."""
    arrived, missed = counts["delivered"] + counts["late"], counts["missed"]
    if not missed:
        return f"all {arrived} exchanges of parameters took place; {counts['late']} of them late"
    return f"{arrived} exchanges of parameters took place, {counts['late']} of them late; {missed} were missed"


def coarser(states: States) -> States:
    """No more than MOST_COLUMNS columns: of the iterations that share one, the state that matters most."""
    edges = np.linspace(0, states.shape[1], min(MOST_COLUMNS, states.shape[1]), endpoint=False).astype(int)
    return np.asarray(np.maximum.reduceat(states, edges, axis=1))


def _legend(axis: Axes, counts: Counter[str]) -> None:
    handles = [
        Patch(facecolor=EDGES[state], label=f"{words}: {counts[state]}")
        for state, words in WORDS.items()
        if counts[state]
    ]
    axis.legend(handles=handles, fontsize=7, loc="upper left", bbox_to_anchor=(1.0, 1.0))
