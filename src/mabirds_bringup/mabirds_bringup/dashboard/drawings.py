"""Graph and maps of the page as SVG."""

import base64
import html
import io
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mabirds_bringup.draw.colours import EDGES, LEARNER, colour_of
from mabirds_bringup.draw.drawings import arrow_ends, circle
from mabirds_bringup.watch.edges import EdgeState
from mabirds_core.arrays import Array
from mabirds_core.consensus.weights import Edge
from mabirds_core.games.scene import Raster, Scene

SIDE = 300
"""Units of a map's larger side, and of the graph's."""


class Frame(NamedTuple):
    """From metres to units of a drawing, y down."""

    scale: float
    height: float

    def at(self, place: Array) -> tuple[float, float]:
        """Where a place (2,) is drawn."""
        return float(place[0] * self.scale), float((self.height - place[1]) * self.scale)


def graph(learners: tuple[str, ...], states: Mapping[Edge, EdgeState]) -> str:
    """Learners on a circle, an arrow for each edge in the colour of its state, with a legend."""
    raster = Raster(100, 100, 1.0)
    places = circle(len(learners), raster) - [170.0, 50.0]
    frame = Frame(SIDE / 110, 0.0)
    parts = []
    for (sender, receiver), state in states.items():
        (x1, y1), (x2, y2) = (frame.at(end) for end in arrow_ends(places[sender], places[receiver], 14.0))
        parts.append(
            f'<line class="edge {state}" x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}"'
            f' stroke="{EDGES[state]}" stroke-width="2.5" marker-end="url(#{state})"><title>'
            f"{_name(learners, sender)} to {_name(learners, receiver)}: {state}</title></line>"
        )
    for number, place in enumerate(places):
        x, y = frame.at(place)
        parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="12" fill="{LEARNER}"/>')
        parts.append(f'<text x="{x:.1f}" y="{y - 17:.1f}" text-anchor="middle">{_name(learners, number)}</text>')
    arrows = "".join(
        f'<marker id="{state}" viewBox="0 0 10 10" refX="9" refY="5" markerWidth="5" markerHeight="5" orient="auto">'
        f'<path d="M0 0L10 5L0 10z" fill="{colour}"/></marker>'
        for state, colour in EDGES.items()
    )
    half = SIDE / 2
    return (
        f'<svg viewBox="{-half} {-half} {SIDE} {SIDE}" font-size="13" role="img" aria-label="who hears whom">'
        f"<defs>{arrows}</defs>{''.join(parts)}</svg>"
    )


def _name(learners: tuple[str, ...], number: int) -> str:
    return html.escape(learners[number])


def cost_map(scene: Scene, costs: Array, most: float, expert: int, paths: Array | None) -> str:
    """What places cost an expert, in grey; true obstacles framed in red; imagined ways and the goal in its colour.

    Parameters
    ----------
    scene : Scene
        Of the game.
    costs : Array
        Shape (rows, columns).
    most : float
        The cost that is black.
    expert : int
        Index.
    paths : Array or None
        Shape (m, T + 1, N_E, 2) [m].

    Returns
    -------
    str
        SVG.
    """
    raster = scene.raster
    width, height = raster.columns * raster.resolution, raster.rows * raster.resolution
    frame = Frame(SIDE / max(width, height), height)
    size = f'width="{width * frame.scale:.1f}" height="{height * frame.scale:.1f}"'
    shade = np.clip(costs / most, 0, 1) if most > 0 else np.zeros_like(costs)
    grey = np.rint(255 * (1 - shade)).astype(np.uint8)
    pixels = np.repeat(grey[::-1, :, None], 3, axis=2)
    truth = np.zeros((raster.rows, raster.columns, 4), dtype=np.uint8)
    truth[scene.forbidden[::-1]] = (214, 39, 40, 90)
    layers = "".join(
        f'<image {size} preserveAspectRatio="none" style="image-rendering:pixelated" href="{_png(layer)}"/>'
        for layer in (pixels, truth)
    )
    colour, (x, y) = colour_of(expert), frame.at(scene.goals[expert])
    lines = "".join(_line(frame, way[:, expert], colour) for way in (paths if paths is not None else ()))
    goal = f'<circle cx="{x:.1f}" cy="{y:.1f}" r="7" fill="none" stroke="{colour}" stroke-width="3"/>'
    box = f"0 0 {width * frame.scale:.1f} {height * frame.scale:.1f}"
    return f'<svg viewBox="{box}" role="img" aria-label="costs of expert {expert + 1}">{layers}{lines}{goal}</svg>'


def _line(frame: Frame, places: Array, colour: str) -> str:
    points = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(frame.at, places))
    return f'<polyline points="{points}" fill="none" stroke="{colour}" stroke-width="2" opacity="0.8"/>'


def _png(pixels: NDArray[np.uint8]) -> str:
    """Pixels as an image inside the page."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return f"data:image/png;base64,{base64.b64encode(file.getvalue()).decode()}"
