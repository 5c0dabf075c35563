"""Pictures: what learners take places and nearness to cost, with some ways; what the settings were chosen by."""

from collections.abc import Iterator
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from mabirds_bringup.bench.pedestrians.choosing import judged_at
from mabirds_bringup.bench.pedestrians.data import AREA, HEADINGS, WALLS
from mabirds_bringup.bench.pedestrians.features import LEVELS, SOFTNESS
from mabirds_bringup.bench.pedestrians.measure import Findings, mean_costs, wall_cost
from mabirds_bringup.bench.pedestrians.walking import Scene, drawn_by
from mabirds_core.arrays import Array, Vector

DOTS_PER_INCH = 110
SHOWN = 3
"""Held-out pairs with ways of the first learner, WAYS each."""
WAYS = 8
COLOURS = ("tab:red", "tab:blue")
"""Of those who walk north and those who walk south."""
APART = np.linspace(0.0, 4.0, 81)
"""Distances of the curve [m]."""


def save_figures(findings: Findings, seed: int, directory: Path) -> list[str]:
    """Write the pictures; returns their names."""
    names = []
    for name, figure in _figures(findings, seed):
        figure.savefig(directory / name, dpi=DOTS_PER_INCH, bbox_inches="tight")
        plt.close(figure)
        names.append(name)
    return names


def _figures(findings: Findings, seed: int) -> Iterator[tuple[str, Figure]]:
    yield "costs.png", costs_figure(findings, seed)
    yield "settings.png", settings_figure(findings)


def nearness(levels: Vector) -> Vector:
    """What the distances APART cost [nats]."""
    return np.asarray((levels / (1 + np.exp((APART[:, None] - np.array(LEVELS)) / SOFTNESS))).sum(axis=1))


def costs_figure(findings: Findings, seed: int) -> Figure:
    """Costs of places, some ways, and costs of nearness."""
    places, levels = mean_costs(findings.policies)
    figure, (map_axis, ways_axis, near_axis) = plt.subplots(1, 3, figsize=(12.5, 4.8), layout="constrained")
    features = next(iter(findings.policies.values())).features
    image = places.reshape(features.spots.shape).T
    (x, y), half = features.spots.points[[0, -1]].T, features.spots.spacing / 2
    extent = (x[0] - half, x[1] + half, y[0] - half, y[1] + half)
    drawn = map_axis.imshow(image, origin="lower", extent=extent, cmap="viridis")
    figure.colorbar(drawn, ax=map_axis, label="cost of a place [nats]")
    map_axis.set_title(f"at walls places cost {wall_cost(findings):.2f} nats\nmore than where people walk")
    _draw_ways(ways_axis, findings, seed)
    for axis in (map_axis, ways_axis):
        for x1, y1, x2, y2 in WALLS:
            axis.plot([x1, x2], [y1, y2], color="black", lw=3)
        axis.set(aspect="equal", xlabel="x [m]", ylabel="y [m]", xlim=extent[:2], ylim=extent[2:])
    near_axis.plot(APART, nearness(levels), color="tab:purple")
    near_axis.axhline(0.0, color="0.7", lw=0.8)
    near_axis.set(xlabel="distance to who comes towards one [m]", ylabel="cost of a step [nats]")
    near_axis.set_title(f"nearer than {LEVELS[1]:g} m costs, and nobody told")
    return figure


def _draw_ways(axis: Axes, findings: Findings, seed: int) -> None:
    """Of pairs who come closest, as shown and as drawn."""
    policy = next(iter(findings.policies.values()))
    scene = Scene(policy.features.moves, HEADINGS, *AREA)
    draw, rng = drawn_by(policy, scene), np.random.default_rng(seed)
    closest = sorted(findings.held_out, key=lambda pair: _closest(pair.walk.places[pair.walk.seen.all(axis=1)]))
    for pair in closest[:SHOWN]:
        ways = draw(pair.walk, WAYS, rng)
        for role, colour in enumerate(COLOURS):
            seen = pair.walk.seen[:, role]
            axis.plot(*ways[:, seen, role].transpose(2, 1, 0), color=colour, lw=0.5, alpha=0.5)
            axis.plot(*pair.walk.places[seen, role].T, ".-", color=colour, ms=4, lw=1.6)
    axis.set_title("held-out pairs (dots), and ways\nthat a learner's policy draws (thin)")


def _closest(places: Array) -> float:
    """Least distance at a step, of places (n, 2, 2)."""
    return float(np.hypot(*(places[:, 0] - places[:, 1]).T).min(initial=np.inf))


def settings_figure(findings: Findings) -> Figure:
    """Nats a step by cross-validation."""
    figure, axis = plt.subplots(figsize=(6.2, 3.4), layout="constrained")
    choice = findings.choice
    for lookahead, values in choice.curves.items():
        axis.plot(judged_at(choice.most), values, ".-", label=f"{lookahead} steps ahead")
    axis.axvline(choice.iterations, color="0.5", ls=":", label="chosen")
    axis.set(xlabel="iterations", ylabel="nats a step, cross-validated")
    axis.set_title(f"Chosen on training pairs: {choice.lookahead} steps ahead, {choice.iterations} iterations")
    axis.legend()
    return figure
