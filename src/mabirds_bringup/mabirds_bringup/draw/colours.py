"""Colours of experts and of edges, alike in RViz, Foxglove, pictures and the live page."""

from std_msgs.msg import ColorRGBA

EXPERTS = ("#d62728", "#1f77b4", "#2ca02c", "#ff7f0e", "#9467bd", "#8c564b")
"""In turn."""

EDGES = {"delivered": "#2ca02c", "late": "#ff7f0e", "missed": "#d62728", "closed": "#c0c0c0", "unknown": "#808080"}
"""By ``edges.EdgeState``."""

LEARNER, TEXT = "#4c78a8", "#404040"


def colour_of(expert: int) -> str:
    """The colour of an expert by its index."""
    return EXPERTS[expert % len(EXPERTS)]


def rgba(colour: str, alpha: float = 1.0) -> ColorRGBA:
    """A colour such as "#d62728" as a message."""
    red, green, blue = (int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5))
    return ColorRGBA(r=red, g=green, b=blue, a=float(alpha))


def css(colour: ColorRGBA) -> str:
    """The inverse of ``rgba``, without alpha."""
    return "#" + "".join(f"{round(255 * part):02x}" for part in (colour.r, colour.g, colour.b))
