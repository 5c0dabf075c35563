"""A learner that waits for what everybody else has is started again, and nobody else."""

import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from mabirds_bringup.run.deafness import LONGER, PATIENCE, Deafness
from mabirds_bringup.run.network import Network as RunningNetwork
from mabirds_bringup.run.processes import PLAYER
from mabirds_bringup.watch.monitor import MonitorNode
from mabirds_core.experiment.file import load_experiment


class Network:
    """Three learners, as their monitor hears them: learner_2 waits for iteration 4 of learner_1."""

    def __init__(self, own: tuple[str, ...]) -> None:
        self.now, self.lost, self.sent = 0.0, set[str](), dict[str, int]()
        self.deafness = Deafness(own, lambda: self.now)
        self.statuses: dict[str, Any] = {
            "learner_1": SimpleNamespace(iteration=5, waiting_for=["demonstration", "learner_3"]),
            "learner_2": SimpleNamespace(iteration=4, waiting_for=["learner_1"]),
            "learner_3": SimpleNamespace(iteration=4, waiting_for=[]),
        }
        self.parameters = {"learner_1": {1, 2, 3, 4, 5}, "learner_2": {1, 2, 3}, "learner_3": {4}}

    def after(self, seconds: float) -> list[str]:
        """Who is to be started again by then."""
        found, end = list[str](), self.now + seconds
        while self.now < end:
            self.now += 0.5
            deaf = self.deafness.found(self.statuses, self.parameters, self.sent, self.lost.__contains__)
            found += [name for name, _ in deaf]
        return found


def test_who_waits_for_what_is_known_is_started_again_once() -> None:
    network = Network(("learner_1", "learner_2"))
    assert network.after(PATIENCE - 1.0) == []
    assert network.after(2.0) == ["learner_2"]
    assert network.after(PATIENCE - 2.0) == []


def test_why_is_said() -> None:
    network = Network(("learner_2",))
    network.after(0.5)
    network.now += PATIENCE + 0.5
    (deaf,) = network.deafness.found(network.statuses, network.parameters, {}, network.lost.__contains__)
    assert deaf.words == "learner_2 has waited for 20 s for parameters 4 of learner_1, which are known here"


@pytest.mark.parametrize(("own", "seconds"), [(("learner_1",), LONGER), (("learner_3",), 1e3)])
def test_who_is_not_heard_is_started_again_later(own: tuple[str, ...], seconds: float) -> None:
    """Where the other one is another host's; a learner with which all is well is left in peace."""
    network = Network(own)
    assert network.after(LONGER - 1.0) == []
    assert network.after(2.0) == (["learner_1"] if seconds == LONGER else [])


def test_who_waits_for_a_demonstration_that_was_sent_is_started_again_and_then_the_player() -> None:
    network = Network(("learner_1", PLAYER))
    network.statuses["learner_2"].waiting_for, network.sent = [], {"learner_1": 4}
    assert network.after(LONGER + 5.0) == []  # it waits for 5
    network.sent = {"learner_1": 5}
    assert network.after(PATIENCE - 1.0) == []
    assert network.after(2.0) == ["learner_1"]
    again = network.after(LONGER - PATIENCE)
    assert again[-1] == PLAYER
    assert set(again) == {"learner_1", PLAYER}


def test_why_a_learner_that_does_not_hear_the_player_is_started_again() -> None:
    network = Network(("learner_1",))
    network.sent = {"learner_1": 6}
    network.after(0.5)
    network.now += PATIENCE + 0.5
    (deaf,) = network.deafness.found(network.statuses, network.parameters, network.sent, network.lost.__contains__)
    assert deaf.words == "learner_1 has waited for 20 s for demonstration 5, which expert_player sent"


@pytest.mark.parametrize("case", ["deaf", "heard later", "others' host", "before this process began", "stands"])
def test_a_supervisor_that_does_not_hear_what_its_learners_hear_is_deaf(case: str) -> None:
    now = 0.0
    deafness = Deafness(["learner_1"] if case != "others' host" else ["learner_2"], lambda: now)
    parameters = {"learner_1": {1, 2, 3, 4, 5}, "learner_3": {1, 2}}

    def said(iteration: int) -> str | None:
        status = SimpleNamespace(iteration=iteration, mixed_from=["learner_3"], waiting_for=[])
        return deafness.unheard({"learner_1": status}, parameters)

    if case != "before this process began":
        said(3)
    assert said(3 if case == "stands" else 5) is None
    now = PATIENCE + 1.0
    if case == "heard later":
        parameters["learner_3"].add(4)
    words = said(3 if case == "stands" else 5)
    expected = "learner_1 learned with parameters 4 of learner_3, which is not heard here for 20 s"
    assert words == (expected if case == "deaf" else None)


def test_a_run_starts_it_again_and_says_so(
    make_experiment: Callable[..., Path], monkeypatch: pytest.MonkeyPatch
) -> None:
    file = make_experiment(learners=3, schedule={"kind": "directed_ring"})
    seen = Network(())
    for status in seen.statuses.values():
        status.mixed_from = []
    monitor = SimpleNamespace(
        statuses=seen.statuses,
        parameters=seen.parameters,
        player=SimpleNamespace(learners=["learner_1"], sent=[4]),
        presence=SimpleNamespace(is_lost=seen.lost.__contains__),
    )
    restarted = list[str]()
    supervisor: Any = SimpleNamespace(restart=restarted.append)
    network = RunningNetwork(load_experiment(file), file, file.parent, {})
    assert list(network._heal(supervisor, cast("MonitorNode", monitor))) == []
    later = time.monotonic() + PATIENCE + 1.0
    monkeypatch.setattr(network._deafness, "_clock", lambda: later)
    (news,) = network._heal(supervisor, cast("MonitorNode", monitor))
    assert news.startswith(
        "learner_2 is started again, since learner_2 has waited for 21 s for parameters 4 of learner_1"
    )
    assert restarted == ["learner_2"]


def test_in_resilient_mode_nobody_waits(make_experiment: Callable[..., Path]) -> None:
    file = make_experiment(change={"mixing": {"kind": "resilient"}})
    assert not RunningNetwork(load_experiment(file), file, file.parent, {})._deafness._own


@pytest.mark.parametrize("spoil", ["not published", "next iteration", "suspended"])
def test_who_waits_rightly_is_left_in_peace(spoil: str) -> None:
    network = Network(("learner_1", "learner_2", "learner_3"))
    assert network.after(PATIENCE - 1.0) == []
    if spoil == "not published":
        network.parameters["learner_1"] = {1, 2, 3}
    elif spoil == "next iteration":
        network.statuses["learner_2"] = SimpleNamespace(iteration=5, waiting_for=["learner_1"])
    else:
        network.lost.add("learner_2")
    assert network.after(PATIENCE - 1.0) == []
