"""Pictures of benchmarks: curves over seeds, and saving."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

DOTS_PER_INCH = 120


def save_all(figures: Mapping[str, Figure], directory: Path) -> list[str]:
    """Write figures by file name; returns the names."""
    for name, figure in figures.items():
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
    return list(figures)


def draw_band(axis: Axes, name: str, curves: Sequence[Sequence[float]], **style: Any) -> None:
    """The mean over seeds as a line, their range as a band; entry k of a curve is drawn at k."""
    values = np.array(curves)
    line = axis.plot(values.mean(axis=0), label=name, linewidth=1.2, **style)[0]
    axis.fill_between(
        np.arange(values.shape[1]), values.min(axis=0), values.max(axis=0), alpha=0.15, color=line.get_color()
    )
