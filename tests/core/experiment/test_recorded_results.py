"""What configurations with the paper's steps learn in ten iterations, against results that were recorded once.

``python tests/core/experiment/test_recorded_results.py`` writes them when a change of results is meant, and never
otherwise. Where kernels are compiled they agree to the bit on every processor.
"""

import hashlib
import itertools
import json
from pathlib import Path
from typing import Any

import pytest

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.arithmetic import arithmetic
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import History, simulate
from mabirds_core.metrics.metrics import norms
from mabirds_expert_player.recorder import expert_streams

CONFIGURATIONS = Path(__file__).parent / "recorded" / "configurations"
RECORD = Path(__file__).parent / "recorded" / "results.json"
ITERATIONS = 10
QUICK = {"drones": 3, "drones_sac": 2}
"""Iterations of those whose ten take half a minute and more."""
PROCESSORS_OWN = {"drones", "drones_sac"}
"""What is learned with numpy's functions and torch, whose last bits are the processor's."""
NEAR, SEARCHED = 1e-6, 0.02
"""How near lengths are to be; a thousand gradient steps make more of last bits, .0004 in two searches."""


def learn(name: str, iterations: int) -> History:
    experiment = load_experiment(CONFIGURATIONS / f"{name}.yaml")
    streams = expert_streams(experiment, build_game(experiment))
    shown = {learner: list(itertools.islice(stream, iterations)) for learner, stream in streams.items()}
    return simulate(experiment.model_copy(update={"iterations": iterations, "closing_rounds": 0}), shown)


def fingerprint(parameters: Parameters) -> dict[str, str]:
    content = b"".join(values.tobytes() for values in parameters)
    lengths = {name: value.hex() for name, value in norms(parameters).items()}
    return {"sha256": hashlib.sha256(content).hexdigest(), **lengths}


def check(name: str, iterations: int) -> None:
    record: dict[str, Any] = json.loads(RECORD.read_text(encoding="utf-8"))
    nearness = SEARCHED if name == "drones_sac" else NEAR
    to_the_bit = record["arithmetic"] == arithmetic() and name not in PROCESSORS_OWN
    for learner, history in learn(name, iterations).items():
        for n, parameters in enumerate(history, start=1):
            expected, learned = record["results"][name][learner][n - 1], fingerprint(parameters)
            for length in ("theta_norm", "omega_norm"):
                near = pytest.approx(float.fromhex(expected[length]), rel=nearness, abs=1e-12)
                assert float.fromhex(learned[length]) == near, f"{learner} at iteration {n}"
            if to_the_bit:
                assert learned == expected, f"{learner} at iteration {n}"


def names() -> list[str]:
    return sorted(file.stem for file in CONFIGURATIONS.glob("*.yaml"))


@pytest.mark.parametrize("name", names())
def test_every_configuration_learns_what_it_learned_when_recorded(name: str) -> None:
    check(name, QUICK.get(name, ITERATIONS))


@pytest.mark.slow
@pytest.mark.parametrize("name", QUICK)
def test_and_the_long_ones_over_all_ten_iterations(name: str) -> None:
    check(name, ITERATIONS)


def main() -> None:
    results = {
        name: {learner: [fingerprint(one) for one in history] for learner, history in learn(name, ITERATIONS).items()}
        for name in names()
    }
    record = {"arithmetic": arithmetic(), "results": results}
    RECORD.write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
