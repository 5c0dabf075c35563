"""A picture of any enumerable game: what its cost features were learned to cost."""

from collections.abc import Mapping

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.figure import Figure

from mabirds_core.costs.models import costs_of
from mabirds_core.games.interface import TabularGame
from mabirds_core.games.truth import known_constraints
from mabirds_core.games.whole_game import Learned

MAX_SHOWN = 20
"""Features; more would have no room for their names."""


def costs_figure(game: TabularGame, learned: Mapping[str, Learned], threshold: float) -> Figure:
    """Draw the learned costs -omega of the dearest features, true constraints in red where they are known.

    Parameters
    ----------
    game : TabularGame
        With names and true constraints.
    learned : Mapping[str, Learned]
        By name; a panel each.
    threshold : float
        A dashed line.

    Returns
    -------
    Figure
        In one row.
    """
    names, known = np.array(game.cost_features.names), game.true_constraints is not None
    truth = known_constraints(game) if known else np.zeros(len(names), dtype=np.bool_)
    shown = min(MAX_SHOWN, len(names))
    size = (4.5 * len(learned), 0.25 * shown + 1.2)
    figure, axes = plt.subplots(1, len(learned), figsize=size, squeeze=False, layout="constrained")
    for axis, (name, of_one) in zip(axes[0], learned.items(), strict=True):
        omega = costs_of(game).by_feature(of_one.omega)
        dearest = np.argsort(omega)[:shown][::-1]
        axis.barh(names[dearest], -omega[dearest], color=np.where(truth[dearest], "tab:red", "tab:blue"))
        axis.axvline(threshold, color="0.1", linestyle="--", linewidth=0.9)
        axis.tick_params(labelsize=7)
        axis.set_title(name, fontsize=9)
        axis.set_xlabel("learned cost [reward]")
    figure.suptitle("dearest features" + ("; true constraints in red" if known else ""), fontsize=10)
    return figure
