"""The pedestrians of UCY (zara01), and the rules by which they become demonstrations.

Credit: A. Lerner, Y. Chrysanthou, D. Lischinski, "Crowds by Example", Computer Graphics Forum 26(3), 2007.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mabirds_bringup.bench.pedestrians.situations import Walk, walk_of
from mabirds_bringup.importing.fitting import Demonstrated
from mabirds_bringup.importing.importer import Import, import_tracks
from mabirds_bringup.importing.rules import HEADINGS as HEADING_OF
from mabirds_bringup.importing.rules import load_rules
from mabirds_bringup.importing.tracks import Track
from mabirds_msgs_py.errors import BagError

FILE = "obsmat.txt"
"""Columns: frame, person, x, unused, y, vx, unused, vy."""

FRAMES_PER_SECOND = 25.0

COLUMNS = 8

RULES = load_rules(Path(__file__).with_name("rules.yaml"))

AREA = np.array(RULES.area.corners)
"""What is in view, lower left and upper right [m]."""

HEADINGS = np.array([HEADING_OF[str(expert.heads)] for expert in RULES.experts], np.float64)
"""Expert 1 walks north, expert 2 south."""

EXITS = np.array([(expert.goal.centre, expert.goal.until) for expert in RULES.experts])
"""Where they leave: ends of a segment, shape (2, 2, 2) [m]."""

WALLS = np.array([[-7.0, 11.5, -5.0, 11.5], [-5.0, 11.5, -5.0, 7.0], [-5.0, 7.0, -7.0, 6.5]])
"""Those in view, as segments x1 y1 x2 y2 [m]; nobody but the report is told."""

TIME_STEP = RULES.steps.time_step
"""Two samples [s]: at one sample, a quarter of all velocities are equal to the last bit, as the data are splines."""


class Pair(NamedTuple):
    """A walk, and who walks."""

    walk: Walk
    people: tuple[str, str]
    begin: float
    end: float
    """[s]"""


def read_pedestrians(directory: Path) -> list[Track]:
    """Tracks of all people.

    Parameters
    ----------
    directory : Path
        With FILE.

    Returns
    -------
    list[Track]
        One each [s, m].

    Raises
    ------
    BagError
        There is no such file, or it has other columns.
    """
    file = directory / FILE
    if not file.is_file():
        raise BagError(f"{file}: there is no such file; give the directory of ucy_zara01 as --data")
    try:
        table = np.loadtxt(file, ndmin=2)
    except ValueError as error:
        raise BagError(f"{file}: expected {COLUMNS} columns of numbers ({error})") from None
    if table.shape[1] != COLUMNS:
        raise BagError(f"{file}: has {table.shape[1]} columns, expected {COLUMNS}")
    times, people, places = table[:, 0] / FRAMES_PER_SECOND, table[:, 1], table[:, [2, 4]]
    return [
        Track(FILE, f"person {person:g}", times[people == person], places[people == person])
        for person in np.unique(people)
    ]


def imported(tracks: Sequence[Track]) -> Import:
    """Pairs of people by role, the last 40 % of the time held out.

    Parameters
    ----------
    tracks : Sequence[Track]
        Of all people.

    Returns
    -------
    Import
        With learners' and held-out pairs.
    """
    return import_tracks(tracks, RULES, "rules of bench pedestrians")


def pairs(demonstrated: Sequence[Demonstrated]) -> list[Pair]:
    """Walks of what was imported, sampled at TIME_STEP."""
    episodes = [of.episode for of in demonstrated]
    return [Pair(walk_of(of, TIME_STEP), (of.tracks[0].agent, of.tracks[1].agent), of.begin, of.end) for of in episodes]
