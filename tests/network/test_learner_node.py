"""The learner node alone: what it says, what it refuses, how it mends gaps."""

import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from identity import bits
from mabirds_msgs.msg import Demonstration, EdgeSchedule, LearnerStatus
from mabirds_msgs.msg import Parameters as ParametersMessage
from mabirds_msgs.srv import FetchParameters
from rclpy.exceptions import InvalidParameterValueException

from mabirds_core.algorithm.parameters import Parameters
from mabirds_core.errors import CheckpointError, ExperimentError, ScheduleError
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_learner.learner_node import LearnerNode
from mabirds_msgs_py import presence
from mabirds_msgs_py.bag_reader import DemonstrationBag
from mabirds_msgs_py.conversion import parameters_message
from mabirds_msgs_py.qos import STATUS_QOS, announced, latched


class Surroundings:
    """Everything around learner_1: its player, its neighbour learner_2, and a listener to its topics."""

    def __init__(self, nodes: Any, experiment: Experiment, bag: DemonstrationBag) -> None:
        self.experiment = experiment
        self.node = nodes.plain("surroundings")
        self.bag = bag
        self.statuses: list[LearnerStatus] = []
        self.parameters: list[ParametersMessage] = []
        self.schedules: list[EdgeSchedule] = []
        listen, publish = self.node.create_subscription, self.node.create_publisher
        listen(LearnerStatus, "/learner_1/status", self.statuses.append, latched(100))
        listen(ParametersMessage, "/learner_1/parameters", self.parameters.append, latched(100))
        listen(EdgeSchedule, "/learner_1/edge_schedule", self.schedules.append, STATUS_QOS)
        self.demonstrations = publish(Demonstration, "/learner_1/demonstration", latched(100))
        self.neighbour = publish(ParametersMessage, "/learner_2/parameters", announced(100))

    def demonstrate(self, iteration: int, learner: str = "learner_1") -> None:
        self.demonstrations.publish(self.bag.message(learner, iteration))

    def neighbour_says(self, number: int, node: LearnerNode, **changes: Any) -> None:
        message = self.neighbours_message(number, node)
        for name, value in changes.items():
            setattr(message, name, value)
        self.neighbour.publish(message)

    def neighbours_message(self, iteration: int, node: LearnerNode) -> ParametersMessage:
        initial = node.session.learner.initial_state().parameters
        parameters = Parameters(initial.theta + iteration, initial.omega - iteration)
        digests = self.experiment.digest, self.experiment.edge_schedule.digest
        return parameters_message("learner_2", iteration, parameters, *digests, stamp=0)

    @property
    def last(self) -> LearnerStatus:
        return self.statuses[-1]


@pytest.fixture
def file(make_experiment: Callable[..., Path]) -> Path:
    return make_experiment(iterations=5)


@pytest.fixture
def around(nodes: Any, file: Path, open_bag: Callable[..., DemonstrationBag]) -> Surroundings:
    experiment = load_experiment(file)
    return Surroundings(nodes, experiment, open_bag(experiment))


def test_it_announces_itself_its_schedule_and_its_first_guess(nodes: Any, file: Path, around: Surroundings) -> None:
    nodes.learner(file, "learner_1")
    nodes.spin_until(lambda: around.statuses and around.parameters and around.schedules)
    status = around.statuses[0]
    assert status.experiment_digest == around.experiment.digest
    assert status.schedule_digest == around.schedules[0].digest == around.experiment.edge_schedule.digest
    assert (status.iteration, status.last_demonstration, status.backlog) == (1, 0, 0)
    assert list(status.waiting_for) == ["demonstration", "learner_2"]
    assert len(status.metric_values) > 0
    assert around.parameters[0].iteration == 1


def test_a_late_listener_gets_the_history_of_parameters(nodes: Any, file: Path, around: Surroundings) -> None:
    node = nodes.learner(file, "learner_1")
    for iteration in range(1, 6):
        around.demonstrate(iteration)
        around.neighbour_says(iteration, node)
    nodes.spin_until(lambda: node.session.finished)
    late: list[ParametersMessage] = []
    nodes.plain("late").create_subscription(ParametersMessage, "/learner_1/parameters", late.append, latched(64))
    nodes.spin_until(lambda: len(late) == 6)
    assert [message.iteration for message in late] == [1, 2, 3, 4, 5, 6]


def test_what_needs_nobody_else_is_made_before_the_neighbour_says_anything(
    nodes: Any, file: Path, around: Surroundings
) -> None:
    node = nodes.learner(file, "learner_1")
    around.demonstrate(1)
    nodes.spin_until(lambda: node.session.backlog == 1)
    assert (node.session.iteration, node.session.can_prepare) == (1, False), "it is made already"
    around.demonstrate(2)
    around.neighbour_says(1, node)
    nodes.spin_until(lambda: node.session.iteration == 2 and node.session.backlog == 1)
    assert not node.session.can_prepare, "that of the next one follows the update"
    nodes.spin_until(lambda: around.statuses and around.last.iteration == 2)
    metrics = dict(zip(around.last.metric_names, around.last.metric_values, strict=True))
    assert metrics["iteration_seconds"] > 0


def test_it_stalls_on_a_silent_neighbour_and_says_on_whom(nodes: Any, file: Path, around: Surroundings) -> None:
    node = nodes.learner(file, "learner_1", status_period=0.1)
    around.demonstrate(1)
    around.demonstrate(2)
    nodes.spin_until(lambda: around.statuses and around.last.backlog == 2)
    nodes.spin_for(0.5)
    assert around.last.state == LearnerStatus.WAITING_FOR_NEIGHBOURS
    assert list(around.last.waiting_for) == ["learner_2"]
    assert node.session.iteration == 1
    around.neighbour_says(1, node)
    nodes.spin_until(lambda: node.session.iteration == 2)


@pytest.mark.parametrize(
    ("changes", "reason", "text"),
    [
        ({"experiment_digest": "other"}, "wrong_experiment", "experiment digest 'other', expected"),
        ({"schedule_digest": "other"}, "wrong_schedule", "schedule digest 'other', expected"),
        ({"theta": [1.0]}, "wrong_shape", "theta: 1 numbers, expected"),
        ({"learner": "learner_1"}, "wrong_learner", "learner 'learner_1', expected 'learner_2'"),
        ({"iteration": 10_000}, "future_iteration", "iteration 10000, expected less than 257"),
    ],
)
def test_unfit_parameters_are_counted_and_never_mixed(
    nodes: Any, file: Path, around: Surroundings, changes: dict[str, Any], reason: str, text: str
) -> None:
    node = nodes.learner(file, "learner_1")
    around.demonstrate(1)
    around.neighbour_says(1, node, **changes)
    nodes.spin_until(lambda: around.statuses and around.last.drop_reasons)
    assert dict(zip(around.last.drop_reasons, around.last.drop_counts, strict=True)) == {reason: 1}
    assert text in around.last.message
    assert node.session.iteration == 1
    around.neighbour_says(1, node)
    nodes.spin_until(lambda: node.session.iteration == 2)


def test_another_learners_demonstration_is_refused(nodes: Any, file: Path, around: Surroundings) -> None:
    node = nodes.learner(file, "learner_1")
    around.demonstrate(1, learner="learner_2")
    nodes.spin_until(lambda: around.statuses and around.last.drop_reasons)
    assert list(around.last.drop_reasons) == ["wrong_learner"]
    assert node.session.backlog == 0


def test_an_impossible_demonstration_is_named_by_topic_iteration_and_step(
    nodes: Any, file: Path, around: Surroundings
) -> None:
    nodes.learner(file, "learner_1")
    message = around.bag.message("learner_1", 3)
    message.states[4] = 2.0
    message.states[5] = 1.0
    around.demonstrations.publish(message)
    nodes.spin_until(lambda: around.statuses and around.last.drop_reasons)
    assert list(around.last.drop_reasons) == ["impossible_trajectory"]
    assert around.last.message.startswith("dropped demonstration 3: step 0: expert 1 moves")


def test_a_demonstration_of_another_run_is_refused(nodes: Any, file: Path, around: Surroundings) -> None:
    node = nodes.learner(file, "learner_1", run="monday")
    message = around.bag.message("learner_1", 1)
    message.experiment_digest = around.experiment.run_digest("tuesday")
    around.demonstrations.publish(message)
    nodes.spin_until(lambda: around.statuses and around.last.drop_reasons)
    assert list(around.last.drop_reasons) == ["wrong_experiment"]
    message.experiment_digest = around.experiment.run_digest("monday")
    around.demonstrations.publish(message)
    nodes.spin_until(lambda: node.session.backlog == 1)


def test_what_a_neighbour_no_longer_keeps_is_said(nodes: Any, file: Path, around: Surroundings) -> None:
    def answer(_: FetchParameters.Request, response: FetchParameters.Response) -> FetchParameters.Response:
        response.message = "learner_2 keeps iterations 23 to 86"
        return response

    around.node.create_service(FetchParameters, "/learner_2/fetch_parameters", answer)
    nodes.learner(file, "learner_1", status_period=0.1)
    nodes.spin_until(
        lambda: around.statuses and around.last.message == "iteration 1 is missing: learner_2 keeps iterations 23 to 86"
    )


def test_a_gap_is_asked_for_again(nodes: Any, file: Path, around: Surroundings) -> None:
    """learner_2's parameters of iteration 1 never arrive on the topic; its service still has them."""
    asked: list[int] = []

    def answer(request: FetchParameters.Request, response: FetchParameters.Response) -> FetchParameters.Response:
        asked.append(request.iteration)
        response.found, response.parameters = True, around.neighbours_message(request.iteration, node)
        return response

    around.node.create_service(FetchParameters, "/learner_2/fetch_parameters", answer)
    node = nodes.learner(file, "learner_1", status_period=0.1)
    around.demonstrate(1)
    nodes.spin_until(lambda: node.session.iteration == 2)
    assert asked[0] == 1


def test_it_answers_a_neighbour_that_asks_again(nodes: Any, file: Path, around: Surroundings) -> None:
    nodes.learner(file, "learner_1")
    client = around.node.create_client(FetchParameters, "/learner_1/fetch_parameters")
    nodes.spin_until(lambda: around.parameters)
    found = nodes.call(client, FetchParameters.Request(iteration=1))
    assert found.found
    assert found.parameters.theta == around.parameters[0].theta
    missing = nodes.call(client, FetchParameters.Request(iteration=2))
    assert not missing.found
    assert missing.message == "learner_1 keeps iterations 1 to 1"


def test_a_namespace_that_is_no_learner_is_refused(nodes: Any, file: Path) -> None:
    with pytest.raises(ExperimentError, match="'learner_7' is none of the learners"):
        nodes.learner(file, "learner_7")


def test_a_history_too_short_for_the_schedule_is_refused(nodes: Any, make_experiment: Callable[..., Path]) -> None:
    file = make_experiment(learners=4, schedule={"kind": "alternating"}, name="four")
    with pytest.raises(ScheduleError, match="parameter_history 3: .* set at least 7"):
        nodes.learner(file, "learner_1", parameter_history=3)


@pytest.mark.parametrize(
    "parameters", [{"status_period": 0.0}, {"parameter_history": -1}, {"demonstration_history": 255}]
)
def test_parameters_out_of_range_are_refused(nodes: Any, file: Path, parameters: dict[str, Any]) -> None:
    with pytest.raises(InvalidParameterValueException):
        nodes.learner(file, "learner_1", **parameters)


def test_learners_of_a_fleet_find_each_other(nodes: Any, file: Path) -> None:
    """All names are relative: the same experiment runs under /depot, player included."""
    learners = [nodes.learner(file, f"depot/{name}") for name in ("learner_1", "learner_2")]
    from rclpy.parameter import Parameter

    from mabirds_expert_player.player_node import ExpertPlayerNode

    overrides = [Parameter("experiment", value=str(file)), Parameter("hz", value=50.0)]
    nodes.add(ExpertPlayerNode(context=nodes.context, namespace="/depot", parameter_overrides=overrides))
    nodes.spin_until(lambda: all(node.session.finished for node in learners))


def test_a_learner_that_is_kept_waiting_warns_on_diagnostics(make_experiment: Callable[..., Path], nodes: Any) -> None:
    """The neighbour never starts: within a few seconds /diagnostics says who waits for whom."""
    file, heard = make_experiment(iterations=3), list[Any]()
    watcher = nodes.plain()
    watcher.create_subscription(DiagnosticArray, "/diagnostics", lambda message: heard.extend(message.status), 10)
    learner = nodes.learner(file, "learner_1")
    with DemonstrationBag(load_experiment(file).demonstrations.bag, learner.game, ("learner_1", "learner_2")) as bag:
        publisher = watcher.create_publisher(Demonstration, "/learner_1/demonstration", latched(10))
        publisher.publish(bag.message("learner_1", 1))
        nodes.spin_until(lambda: any(status.level == DiagnosticStatus.WARN for status in heard))
    warning = next(status for status in heard if status.level == DiagnosticStatus.WARN)
    assert warning.message == "iteration 1: still waits for learner_2"


def test_two_processes_of_one_name_are_noticed(
    nodes: Any, file: Path, around: Surroundings, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(presence, "LIVELINESS_LEASE", 0.1)
    node = nodes.learner(file, "learner_1", status_period=0.1)
    around.neighbour_says(1, node)
    nodes.spin_until(lambda: around.statuses)
    nodes.spin_for(0.5)
    assert "duplicate_name" not in around.last.drop_reasons
    second = around.node.create_publisher(ParametersMessage, "/learner_2/parameters", announced(8))
    second.publish(around.neighbours_message(1, node))
    nodes.spin_until(lambda: "duplicate_name" in around.last.drop_reasons)
    assert around.last.message == "several processes publish as learner_2; end all but one"
    around.node.destroy_publisher(second)
    nodes.spin_until(lambda: not node.presence.duplicates())


def test_a_namesake_of_another_run_is_no_duplicate(
    nodes: Any, file: Path, around: Surroundings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It publishes to the same topic, and its messages say whose it is."""
    monkeypatch.setattr(presence, "LIVELINESS_LEASE", 0.1)
    node = nodes.learner(file, "learner_1", status_period=0.1, run="monday")
    around.neighbour_says(1, node)
    second = around.node.create_publisher(ParametersMessage, "/learner_2/parameters", announced(8))
    message = around.neighbours_message(1, node)
    message.experiment_digest = "v3-tuesday"
    second.publish(message)
    nodes.spin_until(lambda: around.statuses and "wrong_experiment" in around.last.drop_reasons)
    nodes.spin_for(0.6)
    assert "duplicate_name" not in around.last.drop_reasons


def test_services_of_two_runs_have_names_of_their_own(nodes: Any, file: Path) -> None:
    for run in ("monday", "tuesday", ""):
        nodes.learner(file, "learner_1", run=run)
    experiment, observer = load_experiment(file), nodes.plain("observer")
    tags = [experiment.run_digest(run).rpartition("-")[2][:16] for run in ("monday", "tuesday")]
    expected = {f"/learner_1/fetch_parameters/run_{tag}" for tag in tags} | {"/learner_1/fetch_parameters"}
    nodes.spin_until(lambda: expected <= {name for name, _ in observer.get_service_names_and_types()})


def test_a_learner_goes_on_from_its_checkpoint_and_tells_its_past(
    nodes: Any, file: Path, around: Surroundings, tmp_path: Path
) -> None:
    checkpoints = str(tmp_path / "checkpoints")
    first = nodes.learner(file, "learner_1", checkpoints=checkpoints)
    for iteration in (1, 2, 3):
        around.demonstrate(iteration)
        around.neighbour_says(iteration, first)
    nodes.spin_until(lambda: first.session.iteration == 4)
    with pytest.raises(CheckpointError, match="another process writes its checkpoints here"):
        nodes.learner(file, "learner_1", checkpoints=checkpoints)
    nodes.executor.remove_node(first)
    nodes.all.remove(first)
    first.destroy_node()
    journal = tmp_path / "checkpoints" / "journal"
    journal.write_bytes(journal.read_bytes().rstrip(b"\0")[:-9])
    around.parameters.clear()
    second = nodes.learner(file, "learner_1", checkpoints=checkpoints)
    assert second.session.iteration == 3
    nodes.spin_until(lambda: {message.iteration for message in around.parameters} >= {1, 2, 3})
    nodes.spin_until(lambda: "resumed at iteration 3; journal: the last record is not whole" in around.last.message)
    nodes.spin_until(lambda: second.session.iteration == 4)
    assert bits(second.session.parameters) == bits(first.session.parameters)


def test_checkpoints_of_another_run_are_not_overwritten(nodes: Any, file: Path, tmp_path: Path) -> None:
    checkpoints = str(tmp_path / "checkpoints")
    first = nodes.learner(file, "learner_1", checkpoints=checkpoints, run="monday")
    nodes.all.remove(first)
    first.destroy_node()
    with pytest.raises(CheckpointError, match="no checkpoint can be used .*experiment_digest is"):
        nodes.learner(file, "learner_1", checkpoints=checkpoints, run="tuesday")


def test_a_second_player_a_namesake_and_solitude_are_named(
    nodes: Any, file: Path, around: Surroundings, monkeypatch: pytest.MonkeyPatch
) -> None:
    """By the learner that they concern, within five seconds."""
    started = time.monotonic()
    node = nodes.learner(file, "learner_1", status_period=0.2)
    others = [around.node.create_publisher(Demonstration, "/learner_1/demonstration", latched(1)) for _ in range(2)]
    nodes.spin_until(lambda: around.statuses and "a second expert_player plays to learner_1" in around.last.message)
    assert node.learner_name == "learner_1"
    for publisher in others:
        around.node.destroy_publisher(publisher)
    nodes.learner(file, "learner_1", status_period=0.2)
    nodes.spin_until(lambda: "2 processes of this run are learner_1" in around.last.message)
    assert time.monotonic() - started < 10  # two findings
