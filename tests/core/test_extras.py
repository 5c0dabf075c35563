"""Where a library is missing that only some experiments need, the error says how to get it."""

import subprocess
import sys

import pytest

from mabirds_core.errors import ExperimentError, MabirdsError
from mabirds_core.extras import require

NEURAL = "mabirds_core.games.drones.rewards; mabirds_core.games.drones.rewards.NeuralDroneReward(None, 8, 1.0)"


def test_what_is_there_is_no_error_and_what_is_not_has_a_remedy() -> None:
    require("numpy", "arrays", "somewhere[else]")
    with pytest.raises(ExperimentError, match=r"^birds: .*library no_such_library.*pip install 'somewhere\[else\]'$"):
        require("no_such_library", "birds", "somewhere[else]")
    with pytest.raises(MabirdsError) as caught:
        require("no_such_library", "birds", "somewhere[else]", MabirdsError)
    assert type(caught.value) is MabirdsError


@pytest.mark.parametrize(
    ("library", "module", "extra"),
    [
        ("scipy", "mabirds_core.games.drones.lattice", "mabirds_core[drones]"),
        ("scipy", "mabirds_core.games.drones.pilots", "mabirds_core[drones]"),
        ("torch", "mabirds_core.games.drones.soft_actor_critic", "mabirds_core[sac]"),
        ("torch", "mabirds_core.games.drones.actor_critic_networks", "mabirds_core[sac]"),
        ("torch", NEURAL, "mabirds_core[sac]"),
        ("cryptography", "mabirds_bringup.security.keystore", "mabirds_bringup[security]"),
    ],
)
def test_a_module_that_needs_a_library_names_the_extra(library: str, module: str, extra: str) -> None:
    program = f"""
import sys
from mabirds_core.errors import MabirdsError
sys.modules[{library!r}] = None
try:
    import {module}
except MabirdsError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert f"expected the library {library}, which is not installed; pip install '{extra}'" in done.stdout
