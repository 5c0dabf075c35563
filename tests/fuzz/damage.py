"""Damaged files for any reader: every example follows from its seed and number, and says what was done to the bytes.

    for example in examples(content, donor, seed=1, count=100):
        found = outcome(lambda: read(file), file, example, BagError)

Bits are flipped, pieces cut off, taken out, doubled, put in, brought in from another file of the same kind, and
numbers of 1 to 8 bytes replaced by extreme ones, as lying lengths are.
"""

import random
import struct
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

EXTREMES = (0, 1, 2**7, 2**8 - 1, 2**15, 2**16 - 1, 2**31 - 1, 2**31, 2**32 - 1, 2**40, 2**62, 2**63, 2**64 - 1)

MAX_PIECE = 64
"""Bytes that one damage takes out, puts in or doubles."""

SECONDS = 10.0
"""Of computing that no example may take; sound files of the same size take a few hundredths, or a few of text."""


class Example(NamedTuple):
    """``name`` says where it comes from and what was done."""

    name: str
    content: bytes


def examples(content: bytes, donor: bytes, seed: int, count: int) -> Iterator[Example]:
    """``count`` damaged versions of ``content``; ``donor``: another file to splice from."""
    for number in range(count):
        rng = random.Random(f"{seed} {number}")
        damaged, done = bytearray(content), []
        for _ in range(rng.choice((1, 1, 1, 2, 3))):
            damage = rng.choice(DAMAGES)
            place = rng.randrange(len(damaged) + 1)
            damage(damaged, donor, place, rng)
            done.append(f"{damage.__name__} at {place}")
        yield Example(f"seed {seed}, example {number}: {', '.join(done)}", bytes(damaged))


def flip(content: bytearray, donor: bytes, place: int, rng: random.Random) -> None:
    if place < len(content):
        content[place] ^= 1 << rng.randrange(8)


def truncate(content: bytearray, donor: bytes, place: int, rng: random.Random) -> None:
    del content[place:]


def take_out(content: bytearray, donor: bytes, place: int, rng: random.Random) -> None:
    del content[place : place + rng.randint(1, MAX_PIECE)]


def put_in(content: bytearray, donor: bytes, place: int, rng: random.Random) -> None:
    content[place:place] = rng.randbytes(rng.randint(1, MAX_PIECE))


def double(content: bytearray, donor: bytes, place: int, rng: random.Random) -> None:
    content[place:place] = content[place : place + rng.randint(1, MAX_PIECE)]


def splice(content: bytearray, donor: bytes, place: int, rng: random.Random) -> None:
    """From ``place`` on as in the donor, there or elsewhere."""
    content[place:] = donor[rng.choice((place, rng.randrange(len(donor) + 1))) :]


def lie(content: bytearray, donor: bytes, place: int, rng: random.Random) -> None:
    """An extreme number in place of 1, 2, 4 or 8 bytes."""
    size, letter = rng.choice(((1, "B"), (2, "H"), (4, "I"), (8, "Q")))
    content[place : place + size] = struct.pack(f"<{letter}", rng.choice(EXTREMES) % 2 ** (8 * size))


DAMAGES: tuple[Callable[[bytearray, bytes, int, random.Random], None], ...] = (
    flip,
    truncate,
    take_out,
    put_in,
    double,
    splice,
    lie,
    lie,
)


def outcome(read: Callable[[], Any], file: Path, example: Example, refusal: type[Exception]) -> Any:
    """What ``read`` makes of ``file`` once it holds the example, or its refusal; fails for every other exception."""
    file.write_bytes(example.content)
    start = time.process_time()
    try:
        result = read()
    except refusal as error:
        result = error
    except Exception as error:
        raise AssertionError(f"{example.name}: {type(error).__name__}: {error}") from error
    assert time.process_time() - start < SECONDS, f"{example.name}: took {time.process_time() - start:.1f} s"
    return result
