"""A learner's state as arrays and back: with every step rule and memory the next iterations are the same to the bit."""

import tracemalloc
from typing import Any

import numpy as np
import pytest
from experiments import demonstrations, experiment
from identity import bits

from mabirds_core.algorithm.learner import Learner, LearnerState
from mabirds_core.algorithm.storage import from_arrays, to_arrays
from mabirds_core.arrays import Array
from mabirds_core.errors import CheckpointError
from mabirds_core.experiment.assembly import build_learner
from mabirds_core.experiment.file import Experiment
from mabirds_core.games.interface import Trajectories

DEFAULT: dict[str, Any] = {"algorithm": {}, "learners": ["ann"]}
"""Nothing is said about how to learn."""

KINDS: dict[str, dict[str, Any]] = {
    "default": {},
    "rollouts": {"expectation": "sampled", "rollouts": 5},
    "a window": {"window": 3},
    "a neural reward": {"reward": {"kind": "neural", "hidden": 3}},
    "the paper's steps": {"steps": {"alpha": 2.0, "beta": 1.0}},
    "soft Q-learning": {"policy": {"kind": "soft_q_learning", "episodes": 5, "sweeps": 2}},
}
RULE = {f"steps.{part}.{name}" for part in ("momentum", "squares") for name in ("theta", "omega")}
SUMS = {f"observed.{name}" for name in ("demonstrations", "reward", "cost", "starts", "start_counts")}


def alone(algorithm: dict[str, Any]) -> Experiment:
    """One learner; two starts."""
    return experiment({**DEFAULT, "algorithm": algorithm, "game.starts": [[[0, 0], [0, 2]], [[1, 0], [0, 1]]]})


def copies(arrays: dict[str, Array]) -> dict[str, Array]:
    return {name: values.copy() for name, values in arrays.items()}


def after(learner: Learner, shown: list[Trajectories]) -> LearnerState:
    state = learner.initial_state()
    for demonstration in shown:
        state = learner.step(state, demonstration, {}).state
    return state


@pytest.mark.parametrize("kind", KINDS)
def test_a_learner_that_is_restored_at_every_iteration_learns_the_same_bits(kind: str) -> None:
    settings = alone(KINDS[kind])
    learner, stream = build_learner(settings, "ann"), demonstrations(settings)["ann"]
    state = restored = learner.initial_state()
    for n, demonstration in enumerate(stream, start=1):
        again = build_learner(settings, "ann")
        restored = from_arrays(again, n, copies(to_arrays(again, restored)))
        restored = again.step(restored, demonstration, {}).state
        state = learner.step(state, demonstration, {}).state
        assert bits(restored.parameters) == bits(state.parameters), n
        assert {name: values.tobytes() for name, values in restored.rule.items()} == {
            name: values.tobytes() for name, values in state.rule.items()
        }
    assert state.parameters.theta.any()
    assert state.parameters.omega.any()


def test_a_checkpoint_holds_parameters_what_the_rule_remembers_and_sums() -> None:
    settings = alone({})
    learner, stream = build_learner(settings, "ann"), demonstrations(settings)["ann"]
    assert set(to_arrays(learner, learner.initial_state())) == {"theta", "omega", *RULE, *SUMS}
    state = after(learner, stream[:3])
    arrays = to_arrays(learner, state)
    assert set(arrays) == {"theta", "omega", *RULE, *SUMS}
    assert arrays["steps.momentum.omega"].any()
    assert arrays["observed.demonstrations"].tolist() == [3.0]


def test_a_checkpoint_of_the_papers_steps_and_window_holds_nothing_of_a_rule() -> None:
    settings = alone({"steps": {"alpha": 2.0, "beta": 1.0}, "window": 3})
    learner, stream = build_learner(settings, "ann"), demonstrations(settings)["ann"]
    names = {f"recent.{k}.{part}" for k in (0, 1) for part in ("states", "actions")}
    assert set(to_arrays(learner, after(learner, stream[:5]))) == {"theta", "omega", *names}


@pytest.mark.parametrize(
    ("name", "values", "words"),
    [
        ("steps.momentum.theta", np.zeros(3), "steps: expected arrays .* of the step rule"),
        ("steps.squares.omega", np.zeros((14, 1)), "steps: expected arrays .* of the step rule"),
        ("steps.momentum.omega", np.full(14, np.nan), "steps: expected finite numbers"),
        ("steps.squares.theta", np.full(64, np.inf), "steps: expected finite numbers"),
        ("steps.velocity", np.zeros(2), "steps: expected arrays .* of the step rule, found .*velocity"),
        ("observed.cost", np.zeros(3), "observed.cost: expected 14 finite numbers"),
        ("theta", np.zeros(3), "theta: expected 64 numbers"),
        ("omega", np.full(14, 1e13), "omega: expected 14 numbers of at most 1e\\+12"),
    ],
)
def test_arrays_that_do_not_fit_are_refused_by_name(name: str, values: Array, words: str) -> None:
    settings = alone({})
    learner = build_learner(settings, "ann")
    arrays = to_arrays(learner, after(learner, demonstrations(settings)["ann"][:2]))
    with pytest.raises(CheckpointError, match=words):
        from_arrays(learner, 3, {**arrays, name: values})


@pytest.mark.parametrize("kind", ["default", "the paper's steps"])
def test_a_checkpoint_of_another_step_rule_is_refused(kind: str) -> None:
    other = {"default": "the paper's steps", "the paper's steps": "default"}[kind]
    settings = alone({**KINDS[kind], "window": "all"})
    learner = build_learner(settings, "ann")
    arrays = to_arrays(learner, after(learner, demonstrations(settings)["ann"][:2]))
    with pytest.raises(CheckpointError, match="of the step rule, found"):
        from_arrays(build_learner(alone({**KINDS[other], "window": "all"}), "ann"), 3, arrays)


@pytest.mark.parametrize("name", sorted(RULE | SUMS))
def test_a_missing_array_is_refused(name: str) -> None:
    settings = alone({})
    learner = build_learner(settings, "ann")
    arrays = to_arrays(learner, after(learner, demonstrations(settings)["ann"][:2]))
    del arrays[name]
    with pytest.raises(CheckpointError, match="expected arrays"):
        from_arrays(learner, 3, arrays)


def test_only_one_policy_is_in_memory() -> None:
    """A planner that starts from nothing needs no policy of the iteration before."""
    settings = experiment({**DEFAULT, "algorithm": {}, "game.map": "\n".join(["." * 8] * 8), "game.horizon": 40})
    learner, (shown, *_) = build_learner(settings, "ann"), demonstrations(settings)["ann"]
    state = learner.step(learner.initial_state(), shown, {}).state  # makes what is made once
    tracemalloc.start()
    for _ in range(2):
        state = learner.step(state, shown, {}).state
    kept, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert kept < 0.2 * peak
