"""The script that takes the benchmark's seeds through the ROS network."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

SCRIPT = Path(__file__).resolve().parents[2] / "benches" / "as_nodes.py"


def test_processes_come_to_what_one_loop_comes_to(make_drone_experiment: Callable[..., Path]) -> None:
    file = make_drone_experiment(iterations=2)
    command = [sys.executable, SCRIPT, file, "--first-seed", "7", "--seeds", "1", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    results = json.loads(done.stdout)["results"]
    assert [(one["seed"], one["learner"]) for one in results] == [(7, "learner_1"), (7, "learner_2")]
    for one in results:
        assert one["equals_one_loop"] is True
        assert one["iterations"] == 2
        assert 0 <= one["success_rate"] <= 1
