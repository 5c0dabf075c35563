"""What is measured: steps, windows, schedules, hard constraints, each with all seeds."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

N_LEARNERS = 4
LEARNERS = tuple(f"learner_{number}" for number in range(1, N_LEARNERS + 1))
STEP = 0.2
"""alpha and beta within the theorem's bound, 1/N_L."""
LARGE = 4.0
"""Beyond it, so that 1500 iterations come near an optimum whatever the decay."""

RING: Mapping[str, Any] = {"kind": "static", "graph": "ring"}


class Etas(NamedTuple):
    """Decays of the steps of omega and of theta."""

    eta1: float
    eta2: float


def etas_text(etas: Etas) -> str:
    """(eta1, eta2)."""
    return f"({etas.eta1:g}, {etas.eta2:g})"


SETTINGS = (Etas(0.55, 0.9), Etas(0.75, 0.75), Etas(0.9, 0.55))
EQUAL = SETTINGS[1]


@dataclass(frozen=True)
class TheoryCase:
    """One network on one game.

    Attributes
    ----------
    group, label : str
        What it belongs to, and its name there.
    etas : Etas
        Of the paper's steps; None takes the default rule with the mean of all demonstrations.
    step : float
        alpha and beta.
    window : int
        l.
    schedule : Mapping
        As in an experiment file.
    hard : bool
        Experts who never break a constraint (b = 0), or who do so at times.
    omega : str
        Free; clipped to a box; or with a quadratic price.
    longer : int
        Factor of the number of iterations.
    """

    group: str
    label: str
    etas: Etas | None = EQUAL
    step: float = STEP
    window: int = 1
    schedule: Mapping[str, Any] = field(default_factory=lambda: RING)
    hard: bool = False
    omega: Literal["free", "bounded", "regularised"] = "free"
    longer: int = 1


def _slots(*slots: int) -> dict[str, Any]:
    """Slot k opens the edge from learner k to the next; 0 opens none."""
    edges = [[] if k == 0 else [[LEARNERS[k - 1], LEARNERS[k % N_LEARNERS]]] for k in slots]
    return {"kind": "slots", "slots": edges, "undirected": True}


SCHEDULES: dict[str, Mapping[str, Any]] = {
    "complete": {"kind": "static"},
    "alternating pairs": {"kind": "alternating"},
    "a pair at a time": _slots(1, 2, 3),
    "a pair, then three pauses": _slots(1, 0, 0, 0, 2, 0, 0, 0, 3, 0, 0, 0),
}
"""Beside the ring."""

LONGER = 5
"""How many times as long networks learn hard constraints: their costs settle slowly."""


def _hard(omega: Literal["free", "bounded", "regularised"], etas: Etas) -> TheoryCase:
    label = f"{omega}, {etas_text(etas)}"
    return TheoryCase("hard", label, etas, LARGE, hard=True, omega=omega, longer=LONGER)


RATES = [TheoryCase("rates", etas_text(etas), etas) for etas in SETTINGS]
"""The cases that targets are about; they have all seeds, others half of them."""

BASE = RATES[SETTINGS.index(EQUAL)]
"""Ring, l = 1, steps within the bound: what windows and schedules are compared with."""

OTHERS = [
    *(TheoryCase("large", f"{etas_text(etas)}, steps {LARGE:g}", etas, LARGE) for etas in SETTINGS),
    TheoryCase("large", f"{etas_text(EQUAL)}, steps {10 * LARGE:g}", step=10 * LARGE),
    *(TheoryCase("window", f"l = {window}", window=window) for window in (10, 100)),
    *(TheoryCase("schedule", name, schedule=schedule) for name, schedule in SCHEDULES.items()),
    *(_hard("free", etas) for etas in SETTINGS),
    _hard("bounded", EQUAL),
    _hard("regularised", EQUAL),
    TheoryCase("default", "soft constraints", None),
    TheoryCase("default", "hard constraints", None, hard=True),
]

CASES = [*RATES, *OTHERS]
