"""Learner and player nodes together: on both executors in one process, and as processes, bit for bit as in process."""

from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from identity import assert_same_histories, bits
from mabirds_msgs.msg import LearnerStatus
from rclpy.context import Context
from rclpy.executors import Executor, MultiThreadedExecutor, SingleThreadedExecutor

from mabirds_bringup.commands.demonstrations import demonstrations_of
from mabirds_bringup.commands.simulate import simulate_from_bag, simulate_with_progress
from mabirds_bringup.evaluate.evaluation import evaluate, summary
from mabirds_bringup.evaluate.results import audit
from mabirds_bringup.run.network import Network
from mabirds_bringup.run.processes import PLAYER
from mabirds_bringup.watch.described import describe
from mabirds_bringup.watch.inspector import InspectorNode
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment
from mabirds_core.metrics.curves import late_minimum
from mabirds_learner.checkpoint import CONFIDENCES
from mabirds_learner.parameters_log import VectorLog
from mabirds_msgs_py.bag_writer import BagWriter
from mabirds_msgs_py.qos import latched

PATROL = Path(__file__).resolve().parents[2] / "ros_ws" / "config" / "patrol.yaml"
RING = [["learner_1", "learner_2"], ["learner_2", "learner_3"], ["learner_3", "learner_1"]]
SCHEDULES: dict[str, dict[str, Any]] = {
    "static": {"learners": 2, "schedule": {"kind": "static"}},
    "alternating": {"learners": 4, "schedule": {"kind": "alternating"}},
    "directed ring": {"learners": 3, "schedule": {"kind": "slots", "slots": [RING, []]}},
}


@pytest.mark.parametrize("executor_type", [SingleThreadedExecutor, MultiThreadedExecutor])
@pytest.mark.parametrize("schedule", SCHEDULES)
def test_nodes_in_one_process_equal_the_reference(
    make_experiment: Callable[..., Path],
    nodes: Any,
    context: Context,
    tmp_path: Path,
    executor_type: type[Executor],
    schedule: str,
) -> None:
    file = make_experiment(iterations=8, **SCHEDULES[schedule])
    experiment = load_experiment(file)
    nodes.executor = executor_type(context=context)
    with BagWriter(tmp_path / "recording") as recording:
        monitor = nodes.add(MonitorNode(experiment, recording, context=context))
        for name in experiment.learners:
            nodes.learner(file, name)
        nodes.player(file, hz=50.0)
        nodes.spin_until(lambda: monitor.finished)
    assert_same_histories(monitor.history(), simulate_from_bag(experiment))


MIXING: dict[str, dict[str, Any]] = {"strict": {}, "resilient": {"mixing": {"kind": "resilient", "patience": 60.0}}}


COSTS: dict[str, dict[str, Any]] = {"linear": {}, "network": {"cost": {"kind": "network", "width": 4}}}


@pytest.mark.parametrize("costs", COSTS)
@pytest.mark.parametrize("mixing", MIXING)
def test_nodes_with_the_default_rule_equal_the_reference(
    make_experiment: Callable[..., Path], nodes: Any, context: Context, tmp_path: Path, mixing: str, costs: str
) -> None:
    """Nothing is said about how to learn: momenta and sums stay with their learners, who end by naming constraints."""
    change = {"algorithm": COSTS[costs], "closing_rounds": 1, "constraint_confidence": 0.99, **MIXING[mixing]}
    schedule = {"kind": "static", "graph": "ring"}
    file = make_experiment(iterations=8, learners=4, schedule=schedule, change=change)
    experiment = load_experiment(file)
    inspector = nodes.add(InspectorNode(context=context))
    with BagWriter(tmp_path / "recording") as recording:
        monitor = nodes.add(MonitorNode(experiment, recording, context=context))
        for name in experiment.learners:
            nodes.learner(file, name)
        nodes.player(file, hz=50.0)
        nodes.spin_until(lambda: monitor.finished and len(named(inspector)) == 4)
        heard = inspector.learners.values()  # topics keep no order among each other
        nodes.spin_until(lambda: all(of.parameters and of.feature_names for of in heard))
    history = simulate_from_bag(experiment)
    assert_same_histories(monitor.history(), history)
    assert not monitor.drops
    summaries = summary(experiment, evaluate(experiment, history, demonstrations_of(experiment)), 0.0)["learners"]
    for name, constraints in named(inspector).items():
        assert constraints["by_name"] == summaries[name]["learned_constraints"]
        assert constraints["undetermined"] == summaries[name]["undetermined"] > 0
        assert (constraints["iteration"], constraints["level"]) == (10, experiment.constraint_confidence)
        costliest = describe(inspector.learners[f"/{name}"], top=3)["parameters"]["costliest"]
        assert len(costliest) == (3 if costs == "linear" else 0)
        assert f"{len(constraints['by_name'])} constraints at confidence" in monitor.statuses[name].message


def named(inspector: InspectorNode) -> dict[str, Any]:
    """What learners have said to be forbidden, by their names."""
    contents = {namespace: describe(learner, top=3) for namespace, learner in inspector.learners.items()}
    return {name[1:]: content["constraints"] for name, content in contents.items() if "constraints" in content}


@pytest.mark.parametrize(
    ("rate", "reverse"), [(4.0, False), (40.0, False), (40.0, True)], ids=["4x", "40x", "reversed start"]
)
def test_patrol_as_processes_equals_the_reference(tmp_path: Path, rate: float, reverse: bool) -> None:
    """The shipped experiment: at one rate, at ten times that rate, and started in the opposite order."""
    experiment = load_experiment(PATROL)
    order = [*experiment.learners, PLAYER][:: -1 if reverse else 1]
    (tmp_path / "logs").mkdir()
    history, delivered, *_ = Network(experiment, PATROL, tmp_path, {"rate": rate}, order, shared_run="here").run()
    rounds = experiment.iterations + experiment.closing_rounds
    found = audit(experiment.edge_schedule, delivered, rounds)
    assert found == {"iterations": rounds, "edge_mismatches": [], "connectivity_window": 2}
    assert len(history["learner_1"]) == rounds + 1
    assert_same_histories(history, simulate_from_bag(experiment))
    judged = evaluate(experiment, history, demonstrations_of(experiment)).constraints
    for name in experiment.learners:
        file, whose = tmp_path / "checkpoints" / name / CONFIDENCES, experiment.run_digest("here")
        with closing(VectorLog(file, len(judged[name].learned), whose)) as told:
            assert told[rounds + 1].tobytes() == judged[name].confidences.tobytes(), "what judges make use of"


@pytest.mark.parametrize("planner", ["lattice", "soft_actor_critic", "guided"])
def test_drones_as_processes_equal_the_reference(
    make_drone_experiment: Callable[..., Path], tmp_path: Path, planner: str
) -> None:
    """Four learners, a neural reward, networks that learn: one thread each, and not a bit is different."""
    algorithm = {"reward": {"kind": "neural", "hidden": 8, "bound": 2.0}}
    schedule = {"kind": "alternating"}
    file = make_drone_experiment(planner, algorithm, iterations=6, learners=4, schedule=schedule)
    experiment, directory = load_experiment(file), tmp_path / "run"
    (directory / "logs").mkdir(parents=True)
    history, delivered, *_ = Network(experiment, file, directory, {"hz": 50.0}).run()
    assert audit(experiment.edge_schedule, delivered, 6) == {
        "iterations": 6,
        "edge_mismatches": [],
        "connectivity_window": 2,
    }
    assert_same_histories(history, simulate_from_bag(experiment))


def test_the_shipped_experiment_reaches_its_bar() -> None:
    """What the README shows: behaviour as the experts', no false constraint, one answer."""
    experiment = load_experiment(PATROL)
    streams = demonstrations_of(experiment)
    evaluation = evaluate(experiment, simulate_with_progress(experiment, streams, None), streams)
    for name in experiment.learners:
        success = [row.success_rate for row in evaluation.of(name)]
        assert len(success) == 40 + experiment.closing_rounds + 1
        assert success[-1] >= 0.99
        assert evaluation.of(name)[-1].violation_rate <= 0.01
        assert late_minimum(success) >= 0.98
        assert evaluation.occupancy_distance[name] <= 0.1
        constraints = evaluation.constraints[name]
        assert constraints.errors.false_discovery_rate == 0.0
        assert constraints.learned[-2:].all()  # sharing and swapping
    assert evaluation.consensus_policy <= 0.05


def test_two_runs_in_one_domain_do_not_mix(make_experiment: Callable[..., Path], nodes: Any) -> None:
    """The same names, the same game, other demonstrations: each network learns what its own reference learns."""
    files = {run: make_experiment(iterations=6, name=run, change={"seed": seed}) for seed, run in enumerate(("a", "b"))}
    learners = {
        run: [nodes.learner(file, name, run=run) for name in ("learner_1", "learner_2")] for run, file in files.items()
    }
    for run, file in files.items():
        nodes.player(file, hz=50.0, run=run)
    nodes.spin_until(lambda: all(node.session.finished for network in learners.values() for node in network))
    for run, file in files.items():
        expected = simulate_from_bag(load_experiment(file))
        for node in learners[run]:
            assert bits(node.session.state.parameters) == bits(expected[node.learner_name][-1])


def test_mixing_follows_the_schedule_at_every_iteration(make_experiment: Callable[..., Path], nodes: Any) -> None:
    """The delivered graph, as the learners' statuses tell it, is the scheduled one: closed edges carry nothing."""
    file = make_experiment(iterations=6, **SCHEDULES["directed ring"])
    learners, delivered = load_experiment(file).learners, dict[tuple[str, int], list[str]]()

    def on_status(status: LearnerStatus) -> None:
        if status.iteration > 1:
            delivered[status.learner, status.iteration - 1] = list(status.mixed_from)

    watcher = nodes.plain()
    for name in learners:
        watcher.create_subscription(LearnerStatus, f"/{name}/status", on_status, latched(100))
        nodes.learner(file, name)
    nodes.player(file, hz=20.0)
    nodes.spin_until(lambda: len(delivered) == 3 * 6)
    sender = {"learner_1": "learner_3", "learner_2": "learner_1", "learner_3": "learner_2"}
    assert delivered == {(name, n): [sender[name]] if n % 2 else [] for name in learners for n in range(1, 7)}


def test_closing_rounds_equal_the_reference(
    make_experiment: Callable[..., Path], nodes: Any, context: Context, tmp_path: Path
) -> None:
    file = make_experiment(iterations=5, learners=4, schedule={"kind": "alternating"}, change={"closing_rounds": 3})
    experiment = load_experiment(file)
    with BagWriter(tmp_path / "recording") as recording:
        monitor = nodes.add(MonitorNode(experiment, recording, context=context))
        for name in experiment.learners:
            nodes.learner(file, name)
        player = nodes.player(file, hz=50.0)
        nodes.spin_until(lambda: monitor.finished and player.done)
    history = monitor.history()
    assert {len(parameters) for parameters in history.values()} == {1 + 5 + 3}
    assert_same_histories(history, simulate_from_bag(experiment))
    assert {status.last_demonstration for status in monitor.statuses.values()} == {5}
