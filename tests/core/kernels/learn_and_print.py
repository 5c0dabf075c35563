"""What a learner ends with, by its bits: for ``test_bits``, which runs it on processors that lack some features."""

import hashlib
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

from experiments import demonstrations, experiment

from mabirds_core.experiment.simulate import simulate
from mabirds_core.games.patrol.features import PatrolCostFeatures

LEARNING = {
    "adaptive steps, exact": {"algorithm.steps": {"kind": "adaptive"}, "algorithm.expectation": "exact"},
    "paper's steps, sampled": {},
    "a network": {"algorithm.reward": {"kind": "neural", "hidden": 8, "bound": 4.0}, "algorithm.expectation": "exact"},
    "soft Q-learning": {"algorithm.policy": {"kind": "soft_q_learning", "episodes": 30}},
}


def print_bits(name: str) -> None:
    chosen = experiment(LEARNING[name])
    learned = simulate(chosen, demonstrations(chosen))
    content = b"".join(values.tobytes() for history in learned.values() for values in history[-1])
    print(name, hashlib.sha256(content).hexdigest())  # noqa: T201 - read by the test


def main() -> None:
    for name in LEARNING:
        print_bits(name)
    del PatrolCostFeatures.factored  # nothing factorises any more: tables, as for games of other kinds
    LEARNING["by tables"] = LEARNING["adaptive steps, exact"]
    print_bits("by tables")


if __name__ == "__main__":
    main()
