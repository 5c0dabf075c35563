"""Made-up pedestrians in the format of UCY: two streams on a pavement who turn aside from each other."""

from pathlib import Path

import numpy as np

from mabirds_core.arrays import Array

SAMPLE = 0.4
"""Seconds between two samples, ten frames."""

SOUTH, NORTH = 5.5, 20.2
"""Between which they walk [m]."""

LEFT, RIGHT = -3.8, 0.8
"""Of the pavement [m]."""

PERSONAL = 1.2
"""Nearer than this they turn aside [m]."""


def simulated(people: int, seed: int) -> dict[int, tuple[int, Array]]:
    """First sample and places of each person, shape (n, 2)."""
    rng = np.random.default_rng(seed)
    heading = np.where(np.arange(people) % 2 == 0, 1.0, -1.0)
    begins = np.sort(rng.integers(0, 12 * people, size=people))
    places = np.column_stack([rng.uniform(LEFT, RIGHT, people), np.where(heading > 0, SOUTH, NORTH)])
    speeds, found = rng.normal(1.3, 0.15, people), {k: list[Array]() for k in range(people)}
    for now in range(int(begins[-1]) + 60):
        present = [k for k in range(people) if now >= begins[k] and SOUTH <= places[k, 1] <= NORTH]
        for k in present:
            found[k].append(places[k].copy())
        steps = {k: _step(k, present, places, heading, speeds[k], rng) for k in present}
        for k, step in steps.items():
            places[k] += step
    return {k: (int(begins[k]), np.array(of)) for k, of in found.items()}


def _step(k: int, present: list[int], places: Array, heading: Array, speed: float, rng: np.random.Generator) -> Array:
    velocity = np.array([0.0, heading[k] * speed]) + rng.normal(0.0, 0.05, 2)
    velocity[0] += 0.3 * (max(0.0, LEFT - places[k, 0]) - max(0.0, places[k, 0] - RIGHT))
    for other in present:
        away = places[k] - places[other]
        distance = float(np.hypot(*away))
        if other != k and distance < 2 * PERSONAL:
            velocity[0] += np.sign(away[0]) * 0.8 * np.exp(-((distance / PERSONAL) ** 2))
    return np.asarray(SAMPLE * velocity)


def write_walkers(directory: Path, people: int = 40, seed: int = 1) -> None:
    """An obsmat.txt of made-up people."""
    lines = [
        (10 * (begin + step) + 1, person, x, 0.0, y, 0.0, 0.0, 0.0)
        for person, (begin, places) in simulated(people, seed).items()
        for step, (x, y) in enumerate(places)
    ]
    directory.mkdir(exist_ok=True)
    np.savetxt(directory / "obsmat.txt", sorted(lines))
