"""What /diagnostics says of a session."""

from types import SimpleNamespace
from typing import Any

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from mabirds_learner.diagnostics import learning_diagnostic


def session(**changes: Any) -> Any:
    values = {"iteration": 5, "lag": 1, "backlog": 2, "finished": False, "missing_demonstration": False}
    one = SimpleNamespace(**{**values, "waiting": ["learner_2"], **changes})
    one.waiting_for = lambda: one.waiting
    return one


@pytest.mark.parametrize(
    ("changes", "stalled", "drops", "level", "sentence"),
    [
        ({}, False, {}, DiagnosticStatus.OK, "iteration 5: waits for learner_2"),
        ({}, True, {}, DiagnosticStatus.WARN, "iteration 5: still waits for learner_2"),
        (
            {"waiting": ["demonstration"], "missing_demonstration": True},
            True,
            {},
            DiagnosticStatus.OK,
            "still waits for",
        ),
        ({"waiting": []}, True, {}, DiagnosticStatus.OK, "iteration 5: learning"),
        ({"waiting": [], "finished": True}, True, {}, DiagnosticStatus.OK, "finished"),
        ({"waiting": []}, False, {"duplicate": 3}, DiagnosticStatus.OK, "iteration 5: learning"),
        ({"waiting": []}, False, {"not_finite": 1}, DiagnosticStatus.WARN, "iteration 5: learning"),
    ],
)
def test_level_and_sentence(
    changes: dict[str, Any], stalled: bool, drops: dict[str, int], level: bytes, sentence: str
) -> None:
    message = learning_diagnostic("learner_1", session(**changes), drops, {}, Time(sec=7), stalled=stalled)
    (status,) = message.status
    assert (status.level, status.hardware_id, message.header.stamp.sec) == (level, "learner_1", 7)
    assert sentence in status.message


def test_values_name_what_a_person_would_look_for() -> None:
    message = learning_diagnostic("learner_1", session(), {"not_finite": 4}, {"weight": 0.5}, Time(), stalled=False)
    (status,) = message.status
    assert {value.key: value.value for value in status.values} == {
        "iteration": "5",
        "lag": "1",
        "backlog": "2",
        "waiting for": "learner_2",
        "weight": "0.5",
        "dropped: not_finite": "4",
    }
