"""The first fields of a serialised Demonstration, without making a message of it: a hundredth of the time."""

import struct
from typing import NamedTuple

NUMBERS = {
    name: (struct.Struct(f"{order}I"), struct.Struct(f"{order}Q"))
    for name, order in {b"\x00\x01": "<", b"\x00\x00": ">"}.items()
}
"""How numbers are read, by the first two of the four bytes with which plain CDR names its byte order."""


class DemonstrationHead(NamedTuple):
    """For whom a demonstration is, which it is, and of what game."""

    learner: str
    iteration: int
    game_digest: str


def demonstration_head(data: bytes) -> DemonstrationHead:
    """Read the head of a serialised mabirds_msgs/Demonstration.

    Parameters
    ----------
    data : bytes
        Plain CDR: header (stamp, frame_id), learner, iteration, game_digest, ...

    Returns
    -------
    DemonstrationHead
        As it stands there.

    Raises
    ------
    ValueError
        These bytes are no such thing; struct.error where they end early.
    """
    numbers = NUMBERS.get(data[:2])
    if numbers is None:
        raise ValueError(f"it begins with {data[:4].hex(' ') or 'nothing'}, which is not plain CDR")
    number, long_number = numbers
    _, place = _string(data, 12, number)
    learner, place = _string(data, place, number)
    place = 4 + -(-(place - 4) // 8) * 8
    (iteration,) = long_number.unpack_from(data, place)
    game_digest, _ = _string(data, place + 8, number)
    return DemonstrationHead(learner, iteration, game_digest)


def _string(data: bytes, place: int, number: struct.Struct) -> tuple[str, int]:
    """The string at a place, which is rounded up to a multiple of 4, and where it ends."""
    place = -(-place // 4) * 4
    (length,) = number.unpack_from(data, place)
    end = place + 4 + length
    if length == 0 or end > len(data):
        raise ValueError(f"a string of {length} bytes, with its end, in a message of {len(data)}")
    return data[place + 4 : end - 1].decode(), end
