"""Pictures inside a page, so that it is one file."""

import base64
from pathlib import Path
from typing import NamedTuple


class Picture(NamedTuple):
    """A picture of a page.

    Attributes
    ----------
    source : str
        A file beside the page, or the picture itself.
    words : str
        What it shows.
    """

    source: str
    words: str


def embedded(file: Path, words: str) -> Picture:
    """A PNG as part of the page."""
    data = base64.b64encode(file.read_bytes()).decode()
    return Picture(f"data:image/png;base64,{data}", words)
