"""What configurations with the paper's steps learn in ten iterations, against results that were recorded once.

``python tests/core/experiment/test_recorded_results.py`` writes them when a change of results is meant, and never
otherwise. numpy's sums round otherwise with another kernel of OpenBLAS, so each kernel has a record of its own.
OPENBLAS_CORETYPE=Haswell takes that kernel on a newer processor.
"""

import ctypes
import hashlib
import itertools
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.experiment.assembly import build_game
from mabirds_core.experiment.file import load_experiment
from mabirds_core.experiment.simulate import History, simulate
from mabirds_core.metrics.metrics import norms
from mabirds_expert_player.recorder import expert_streams

CONFIGURATIONS = Path(__file__).parent / "recorded" / "configurations"
RECORDS = Path(__file__).parent / "recorded"
ITERATIONS = 10
QUICK = {"drones_sac": 2}
"""Iterations of those whose ten take a minute."""


def learn(name: str, iterations: int) -> History:
    experiment = load_experiment(CONFIGURATIONS / f"{name}.yaml")
    streams = expert_streams(experiment, build_game(experiment))
    shown = {learner: list(itertools.islice(stream, iterations)) for learner, stream in streams.items()}
    return simulate(experiment.model_copy(update={"iterations": iterations, "closing_rounds": 0}), shown)


def fingerprint(parameters: Parameters) -> dict[str, str]:
    content = b"".join(values.tobytes() for values in parameters)
    lengths = {name: value.hex() for name, value in norms(parameters).items()}
    return {"sha256": hashlib.sha256(content).hexdigest(), **lengths}


def processor() -> list[str]:
    """What numpy makes use of: other processors may round the last bit of exp otherwise."""
    features = np._core._multiarray_umath.__cpu_features__
    return sorted(name for name, present in features.items() if present)


def kernel() -> str:
    """Which kernel the OpenBLAS in numpy's wheel takes on this processor; other builds of numpy are "other"."""
    for file in Path(np.__file__).parents[1].glob("numpy.libs/libscipy_openblas64_*"):
        name = ctypes.CDLL(str(file)).scipy_openblas_get_corename64_
        name.restype = ctypes.c_char_p
        return str(name().decode())
    return "other"


def record_file() -> Path:
    return RECORDS / f"{kernel().lower()}.json"


def recorded() -> tuple[dict[str, Any], bool]:
    """A record, and whether it is one of a processor like this, which must agree to the bit."""
    same_kernel = record_file().exists()
    file = record_file() if same_kernel else min(RECORDS.glob("*.json"))
    content: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
    return content, same_kernel and content["processor"] == processor()


def check(name: str, iterations: int) -> None:
    record, to_the_bit = recorded()
    for learner, history in learn(name, iterations).items():
        for n, parameters in enumerate(history, start=1):
            expected, learned = record["results"][name][learner][n - 1], fingerprint(parameters)
            for length in ("theta_norm", "omega_norm"):
                near = pytest.approx(float.fromhex(expected[length]), rel=1e-6, abs=1e-12)
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
    record = {"kernel": kernel(), "processor": processor(), "results": results}
    record_file().write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
