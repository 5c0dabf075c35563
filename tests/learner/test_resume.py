"""A session that goes on from its checkpoint does what it would have done without the interruption."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from identity import bits
from sessions import Streams, demonstrations

from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError, MabirdsError, RefusedMessageError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.experiment.simulate import History, simulate
from mabirds_learner.checkpoint import LASTING, CheckpointMetadata, CheckpointStore
from mabirds_learner.learner_session import OTHER_BAG, LearnerSession
from mabirds_learner.member import Limits
from mabirds_learner.strict_member import StrictMember

PAPER: dict[str, Any] = {"steps": {"alpha": 8.0, "beta": 4.0}, "expectation": "sampled", "rollouts": 20}
NEURAL: dict[str, Any] = {"reward": {"kind": "neural", "hidden": 4}}
SOFT_Q: dict[str, Any] = {"policy": {"kind": "soft_q_learning", "episodes": 10, "sweeps": 2}}
ALGORITHMS: dict[str, dict[str, Any]] = {
    "nothing given": {},
    "a neural reward": NEURAL,
    "soft Q-learning": SOFT_Q,
    "a window of three": {"window": 3},
    "the paper's steps": PAPER,
    "the paper's steps and a window of three": {**PAPER, "window": 3},
    "the paper's steps and soft Q-learning": {**PAPER, **SOFT_Q},
    "the paper's steps and a neural reward": {**PAPER, **NEURAL},
}
TWO_STARTS: dict[str, Any] = {
    "kind": "patrol",
    "map": "....\n.##.\n....",
    "starts": [[[0, 0], [2, 3]], [[0, 1], [2, 2]]],
    "goals": [[2, 3], [0, 0]],
    "horizon": 7,
}


def new_session(experiment: Experiment) -> LearnerSession[StrictMember]:
    limits = Limits(experiment.iterations, 256, 64)
    return LearnerSession(StrictMember(build_learner(experiment, "learner_1"), limits))


def advance(session: LearnerSession[StrictMember], streams: Streams, expected: History) -> None:
    """One update with what learner_2 and the player would have sent."""
    n = session.iteration
    session.receive_demonstration(n, streams["learner_1"][n - 1])
    session.member.receive_parameters("learner_2", n, expected["learner_2"][n - 1])
    session.step()


def test_demonstrations_of_another_bag_are_refused_until_the_first_one_is_back(
    make_experiment: Callable[..., Path],
) -> None:
    """A player repeats what a learner says that it learned last; after a restart, too, it is known what that was."""
    experiment = load_experiment(make_experiment())
    streams = demonstrations(experiment)
    expected = simulate(experiment, streams)
    first = new_session(experiment)
    advance(first, streams, expected)
    advance(first, streams, expected)
    session = new_session(experiment)
    session.restore({3: first.arrays()})
    other = next(
        shown for shown in streams["learner_2"] if shown.actions.tobytes() != streams["learner_1"][1].actions.tobytes()
    )
    with pytest.raises(
        RefusedMessageError, match="demonstration 2 is another one .* bring the first bag back"
    ) as caught:
        session.receive_demonstration(2, other)
    assert caught.value.reason == OTHER_BAG
    with pytest.raises(RefusedMessageError, match="bring the first bag back"):
        session.receive_demonstration(3, streams["learner_2"][2])
    with pytest.raises(RefusedMessageError, match="iteration 2, expected 3 or later"):
        session.receive_demonstration(2, streams["learner_1"][1])
    while not session.finished:
        advance(session, streams, expected)
    assert bits(session.parameters) == bits(expected["learner_1"][-1])


def test_demonstrations_that_name_another_bag_are_refused_also_after_a_restart(
    make_experiment: Callable[..., Path],
) -> None:
    """The first that names a bag decides; who names none is believed, since players by hand know of none."""
    experiment = load_experiment(make_experiment())
    streams = demonstrations(experiment)
    one, other = "1" * 64, "2" * 64
    first = new_session(experiment)
    first.receive_demonstration(1, streams["learner_1"][0], one)
    session = new_session(experiment)
    session.restore({1: first.arrays()})
    for learner in (first, session):
        with pytest.raises(RefusedMessageError, match=f"with digest {other}, those before it from {one}") as caught:
            learner.receive_demonstration(2, streams["learner_1"][1], other)
        assert caught.value.reason == OTHER_BAG
        learner.receive_demonstration(2, streams["learner_1"][1])
        learner.receive_demonstration(3, streams["learner_1"][2], one)


@pytest.mark.parametrize("algorithm", ALGORITHMS)
def test_a_restart_before_every_update_changes_no_bit(make_experiment: Callable[..., Path], algorithm: str) -> None:
    check_restarts(load_experiment(make_experiment(change={"algorithm": ALGORITHMS[algorithm]})))


def test_a_restart_from_files_before_every_update_changes_no_bit(
    make_experiment: Callable[..., Path], tmp_path: Path
) -> None:
    """With nothing given: what the default rule and the mean of all demonstrations remember goes through the disk."""
    experiment = load_experiment(make_experiment(change={"algorithm": {}, "game": TWO_STARTS}))
    streams, metadata = demonstrations(experiment), CheckpointMetadata("learner_1", "experiment", "schedule")
    assert len({int(stream.states[0, 0]) for stream in streams["learner_1"]}) == 2
    expected = simulate(experiment, streams)
    session = new_session(experiment)
    while not session.finished:
        advance(session, streams, expected)
        store = CheckpointStore(tmp_path / "checkpoints", metadata, session.parameters, keep=4)
        store.save(session.iteration, session.arrays())
        store.close()
        session = new_session(experiment)
        store = CheckpointStore(tmp_path / "checkpoints", metadata, session.parameters, keep=4)
        session.restore(store.load())
        store.close()
        assert bits(session.parameters) == bits(expected["learner_1"][session.iteration - 1])


@pytest.mark.parametrize("planner", ["lattice", "soft_actor_critic", "guided"])
def test_a_restart_changes_no_bit_with_drones(make_drone_experiment: Callable[..., Path], planner: str) -> None:
    """Networks, optimisers and replay of an actor-critic are in the checkpoint; older ones keep theta and omega."""
    check_restarts(load_experiment(make_drone_experiment(planner)))


def check_restarts(experiment: Experiment) -> None:
    streams = demonstrations(experiment)
    expected = simulate(experiment, streams)
    session, checkpoints = new_session(experiment), dict[int, dict[str, Array]]()
    while not session.finished:
        advance(session, streams, expected)
        checkpoints = {n: {name: arrays[name] for name in LASTING} for n, arrays in checkpoints.items()}
        checkpoints[session.iteration] = {name: values.copy() for name, values in session.arrays().items()}
        session = new_session(experiment)
        session.restore(checkpoints)
        assert bits(session.parameters) == bits(expected["learner_1"][session.iteration - 1])
        assert session.mixed_from == ["learner_2"]
        assert {n: bits(own) for n, own in session.kept.items()} == {
            n: bits(expected["learner_1"][n - 1]) for n in checkpoints
        }


def a_checkpoint(experiment: Experiment) -> dict[str, Array]:
    session, streams = new_session(experiment), demonstrations(experiment)
    expected = simulate(experiment, streams)
    for _ in range(3):
        advance(session, streams, expected)
    return session.arrays()


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("theta", np.ones(3), "theta: expected 98 numbers of at most 1e\\+12"),
        ("omega", np.array([np.nan]), "omega: expected 26 numbers"),
        ("recent.0.states", np.full((8, 4), 0.5), "states"),
        ("recent.0.actions", np.ones((2, 2)), "actions: shape \\(2, 2\\), expected \\(8, 2\\)"),
        ("policy.visited", np.array([3.0, 1.0]), "visited states: expected rising numbers of states below 144"),
        ("policy.visited", np.array([0.5]), "visited states"),
        ("policy.visited", np.array([144.0]), "visited states"),
        ("policy.visited", np.array([-1.0]), "visited states"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(
    make_experiment: Callable[..., Path], name: str, values: Array, words: str
) -> None:
    algorithm = {**PAPER, **SOFT_Q, "window": 2}
    check_refusal(load_experiment(make_experiment(change={"algorithm": algorithm})), name, values, words)


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("steps.momentum.theta", np.ones(3), "steps: expected arrays"),
        ("steps.squares.omega", np.full(26, np.nan), "steps: expected finite numbers"),
        ("observed.reward", np.ones(3), "observed.reward: expected 96 finite numbers"),
        ("observed.starts", np.array([144.0]), "observed.starts: expected numbers of states below 144"),
        ("observed.start_counts", np.array([0.5]), "observed.start_counts: expected whole numbers from 1"),
        ("observed.demonstrations", np.array([-1.0]), "observed.demonstrations: expected one whole number"),
    ],
)
def test_arrays_of_the_default_rule_that_do_not_fit_are_refused(
    make_experiment: Callable[..., Path], name: str, values: Array, words: str
) -> None:
    check_refusal(load_experiment(make_experiment(change={"algorithm": {}})), name, values, words)


def check_refusal(experiment: Experiment, name: str, values: Array, words: str) -> None:
    sound = a_checkpoint(experiment)
    assert name in sound
    with pytest.raises(MabirdsError, match=words):
        new_session(experiment).restore({4: {**sound, name: values}})


def test_a_value_too_large_is_refused(experiment: Experiment) -> None:
    sound = a_checkpoint(experiment)
    sound["omega"] = sound["omega"] + 1e200
    with pytest.raises(CheckpointError, match="omega: expected"):
        new_session(experiment).restore({4: sound})


def test_what_lasts_of_a_checkpoint_is_no_place_to_go_on_from(experiment: Experiment) -> None:
    """With theta and omega alone, the window and the policy would be lost without a word."""
    lasting = {name: values for name, values in a_checkpoint(experiment).items() if name in LASTING}
    with pytest.raises(CheckpointError, match="no checkpoint is whole"):
        new_session(experiment).restore({4: lasting})


def test_it_goes_on_from_the_newest_that_is_whole_and_keeps_all_the_oldest_first(experiment: Experiment) -> None:
    session, streams = new_session(experiment), demonstrations(experiment)
    expected, checkpoints = simulate(experiment, streams), dict[int, dict[str, Array]]()
    for _ in range(4):
        advance(session, streams, expected)
        checkpoints[session.iteration] = session.arrays()
    checkpoints[5] = {name: checkpoints[5][name] for name in LASTING}
    again = new_session(experiment)
    again.restore({n: checkpoints[n] for n in (4, 2, 5, 3)})
    assert (again.iteration, list(again.kept)) == (4, [2, 3, 4, 5])
    assert bits(again.parameters) == bits(expected["learner_1"][3])
