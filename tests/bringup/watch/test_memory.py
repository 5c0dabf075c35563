"""A monitor needs the same memory after 10,000 iterations as after 2,000."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import psutil
import yaml
from mabirds_msgs.msg import LearnerStatus
from rclpy.context import Context

from mabirds_bringup.run.recording import Recording
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_msgs_py.conversion import parameters_message

ITERATIONS = 10_000
MEBIBYTE = 2**20


def test_memory_is_flat(context: Context, make_experiment: Callable[..., Path], tmp_path: Path) -> None:
    file = make_experiment(iterations=1)
    content: dict[str, Any] = yaml.safe_load(file.read_text(encoding="utf-8"))
    content["demonstrations"]["per_learner"] = ITERATIONS
    file.write_text(yaml.safe_dump({**content, "iterations": ITERATIONS}), encoding="utf-8")
    experiment, used = load_experiment(file), dict[int, float]()
    with Recording(tmp_path / "run") as recording:
        monitor = MonitorNode(experiment, recording, context=context, directory=tmp_path / "run" / "parameters")
        digests = monitor._admission.digest, experiment.edge_schedule.digest
        for n in range(1, ITERATIONS + 1):
            for name in monitor.names:
                monitor._on_parameters(name, parameters_message(name, n, monitor._admission.initial[name], *digests, n))
                for _ in range(3):
                    monitor._on_status(name, status(name, n, *digests))
            if n in {2_000, ITERATIONS}:
                assert monitor.consensus() == (n, 0.0, 0.0)
                used[n] = psutil.Process().memory_info().rss / MEBIBYTE
        assert monitor.parameters["learner_1"].gaps(ITERATIONS) == []
        assert len(monitor.delivered()) == ITERATIONS - 1
        monitor.destroy_node()
    assert used[ITERATIONS] - used[2_000] < 4.0  # 3.3 a thousand iterations when all was kept


def status(name: str, n: int, digest: str, schedule: str) -> LearnerStatus:
    others = [other for other in ("learner_1", "learner_2") if other != name]
    return LearnerStatus(
        learner=name,
        experiment_digest=digest,
        schedule_digest=schedule,
        state=LearnerStatus.LEARNING,
        iteration=n,
        last_demonstration=n - 1,
        mixed_from=others,
    )
