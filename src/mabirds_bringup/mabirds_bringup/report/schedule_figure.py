"""The graph of each slot of a schedule as a picture."""

from math import ceil

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_core.consensus.schedule import EdgeSchedule

MAX_SLOTS = 24
"""More slots than these are not drawn."""

COLUMNS = 4


def schedule_figure(schedule: EdgeSchedule) -> Figure:
    """A panel per slot: learners on a circle, an arrow for each open edge, its weight beside it."""
    shown = min(len(schedule.slots), MAX_SLOTS)
    columns = min(shown, COLUMNS)
    size = (2.6 * columns, 2.7 * ceil(shown / columns))
    figure, axes = plt.subplots(ceil(shown / columns), columns, figsize=size, squeeze=False, layout="constrained")
    for slot, axis in enumerate(axes.flat):
        axis.axis("off")
        if slot < shown:
            _draw_slot(axis, schedule, slot)
    rest = "" if shown == len(schedule.slots) else f", the first {shown} of {len(schedule.slots)} slots"
    figure.suptitle(f"after the last slot: {schedule.end}{rest}", fontsize=9)
    return figure


def _draw_slot(axis: Axes, schedule: EdgeSchedule, slot: int) -> None:
    count = len(schedule.learners)
    angles = np.pi / 2 - 2 * np.pi * np.arange(count) / count
    places = np.column_stack([np.cos(angles), np.sin(angles)])
    for sender, receiver in sorted(schedule.slots[slot]):
        axis.annotate(
            "",
            xy=tuple(places[receiver]),
            xytext=tuple(places[sender]),
            arrowprops={"arrowstyle": "->", "color": "tab:blue", "shrinkA": 9, "shrinkB": 9, "lw": 1.1},
        )
    for name, (x, y) in zip(schedule.learners, places, strict=True):
        axis.text(x, y, name, ha="center", va="center", fontsize=7, bbox={"boxstyle": "round", "fc": "white"})
    axis.set(xlim=(-1.5, 1.5), ylim=(-1.4, 1.4), aspect="equal")
    axis.set_title(f"slot {slot + 1}", fontsize=8)
