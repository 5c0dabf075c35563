"""The same bits on every processor: whichever instructions it has, and whatever numpy and OpenBLAS make of them."""

import ctypes
import os
import platform
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from games import hallway, patrol, trio

from mabirds_core import arithmetic
from mabirds_core.games.interface import Trajectories
from mabirds_core.kernels import factored
from mabirds_core.kernels.loading import library
from mabirds_core.planners.factored import FactoredVisitation, factored_policy, factored_reward
from mabirds_core.rewards.models import LinearReward

HERE = Path(__file__).parent
SOURCES = HERE.parents[2] / "src" / "mabirds_core" / "mabirds_core" / "kernels"
FLAGS = ["-std=gnu11", "-O3", "-ffp-contract=off", "-fno-trapping-math", "-shared", "-fPIC"]
LEVELS = {"x86-64": "SSE2", "x86-64-v3": "AVX2", "x86-64-v4": "AVX512_SKX"}
"""Kinds of processors, with a feature by which numpy tells that this is one."""

kernels_needed = pytest.mark.skipif(library() is None, reason="kernels are not compiled")
GCC = shutil.which("gcc")
gcc_needed = pytest.mark.skipif(
    platform.machine() != "x86_64" or GCC is None, reason="compiles for several x86-64 processors with gcc"
)


def built_for(level: str, folder: Path) -> ctypes.CDLL:
    target = folder / f"{level}.so"
    sources = [str(file) for file in SOURCES.glob("*.c") if file.name != "module.c"]
    subprocess.run([str(GCC), *FLAGS, f"-march={level}", "-DKERNEL=", "-o", str(target), *sources], check=True)
    return ctypes.CDLL(str(target))


def computed() -> list[bytes]:
    """Everything that the kernels say of three games, small weights and large ones, and of exp and log."""
    rng = np.random.default_rng(0)
    x = np.concatenate([rng.normal(size=1000), rng.uniform(-700, 700, size=1003)])
    arrays = [arithmetic.exp(x), arithmetic.log(np.abs(x)), arithmetic.tanh(x)]
    room = patrol("....\n....\n.#..", [((0, 0), (2, 3))], ((2, 3), (0, 0)), 20, 0.95)
    for game, scale in ((room, 1.0), (room, 200.0), (hallway(horizon=9), 5.0), (trio(), 1.0)):
        theta = scale * rng.normal(size=len(game.reward_features.names))
        omega = -scale * rng.exponential(size=len(game.cost_features.names))
        reward = factored_reward(LinearReward(game.reward_features), game.cost_features, theta, omega)
        assert reward is not None
        policy = factored_policy(game, reward)
        visitation = policy.visitation(game.initial_distribution)
        assert isinstance(visitation, FactoredVisitation)
        states = rng.integers(game.n_states, size=(5, game.horizon + 1))
        actions = rng.integers(game.n_actions, size=states.shape)
        likelihoods = policy.log_likelihoods(Trajectories(states, actions))
        arrays += [*policy.solution, *visitation.totals, likelihoods]
    return [array.tobytes() for array in arrays]


@kernels_needed
@gcc_needed
@pytest.mark.parametrize("level", LEVELS)
def test_kernels_compiled_for_any_processor_agree(level: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if not np._core._multiarray_umath.__cpu_features__[LEVELS[level]]:
        pytest.skip(f"this processor is none of {level}")
    expected = computed()
    kernels = built_for(level, tmp_path)
    for module in (arithmetic, factored):
        monkeypatch.setattr(module, "library", lambda: kernels)
    assert computed() == expected


LEARN = HERE / "learn_and_print.py"
NO_AVX512 = "X86_V4 AVX512_ICL AVX512_SPR"
PROCESSORS = {
    "as it is": {},
    "without AVX-512": {"NPY_DISABLE_CPU_FEATURES": NO_AVX512, "OPENBLAS_CORETYPE": "Haswell"},
    "without AVX": {"NPY_DISABLE_CPU_FEATURES": f"X86_V3 {NO_AVX512}", "OPENBLAS_CORETYPE": "Prescott"},
    "another libm": {"GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX512F", "OPENBLAS_CORETYPE": "Nehalem"},
}


def printed(environment: dict[str, str]) -> dict[str, str]:
    """What each configuration learned on such a processor."""
    names = ("NPY_DISABLE_CPU_FEATURES", "OPENBLAS_CORETYPE", "GLIBC_TUNABLES")
    inherited = {name: value for name, value in os.environ.items() if name not in names}
    path = os.pathsep.join(sys.path)
    command = [sys.executable, "-W", "ignore", str(LEARN)]
    done = subprocess.run(
        command, env={**inherited, "PYTHONPATH": path, **environment}, check=True, capture_output=True, text=True
    )
    return dict(line.rsplit(" ", 1) for line in done.stdout.splitlines())


@kernels_needed
@pytest.mark.skipif(platform.machine() != "x86_64", reason="numpy's features are those of x86-64")
def test_what_is_learned_is_the_same_on_every_processor() -> None:
    reference = printed(PROCESSORS["as it is"])
    assert len(reference) == 5
    for environment in list(PROCESSORS.values())[1:]:
        assert printed(environment) == reference
