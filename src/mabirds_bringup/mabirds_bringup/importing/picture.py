"""The picture of an import: what was recorded, and what became demonstrations of it."""

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.importing.importer import Import

COLOURS = ("tab:red", "tab:blue", "tab:green", "tab:orange", "tab:purple", "tab:brown")
"""Of experts, in turn."""

MAX_SHOWN = 60
"""Demonstrations in the picture."""


def import_figure(result: Import) -> Figure:
    """Draw recordings with demonstrations, and residuals.

    Parameters
    ----------
    result : Import
        Of the recordings.

    Returns
    -------
    Figure
        Two panels.
    """
    figure, (recorded, residuals) = plt.subplots(1, 2, figsize=(10.5, 4.2), layout="constrained")
    for track in result.tracks:
        recorded.plot(*track.places.T, lw=0.6, color="0.6", zorder=1)
    for of in result.demonstrations[:MAX_SHOWN]:
        for number, colour in zip(range(of.places.shape[1]), COLOURS, strict=False):
            recorded.plot(*of.places[:, number].T, ".-", ms=3, lw=0.8, color=colour)
    title = f"{len(result.demonstrations)} demonstrations of {len(result.tracks)} recorded stretches (grey)"
    recorded.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", title=title)
    _draw_residuals(residuals, result)
    return figure


def _draw_residuals(axis: Axes, result: Import) -> None:
    values = np.sort(np.concatenate([of.residuals for of in result.demonstrations]))
    axis.plot(values, np.linspace(0, 1, len(values)), color="tab:blue")
    limit = float(np.quantile(values, 0.95))
    axis.axvline(limit, color="0.5", ls=":", label=f"95 % below {limit:.3f} m")
    axis.set(xlabel="residual [m]", ylabel="share of samples", title="how far demonstrations are from samples")
    axis.legend()
