"""Learned constraints as messages."""

from typing import Any

import numpy as np
import pytest

from mabirds_core.errors import RefusedMessageError
from mabirds_msgs_py.constraints_conversion import constraints_message, constraints_text, read_constraints

NAMES = ("free", "likely", "sure", "shown")
CONFIDENCES = np.array([0.2, 0.96, 1.0, -1.0])


def test_the_surest_come_first_and_the_rest_is_counted() -> None:
    message = constraints_message(NAMES, CONFIDENCES, level=0.95)
    assert read_constraints(message) == {"sure": 1.0, "likely": 0.96}
    assert list(message.names) == ["sure", "likely"]
    assert message.undetermined == 1


def test_in_words() -> None:
    message = constraints_message(NAMES, CONFIDENCES, level=0.95)
    assert constraints_text(message, 1) == "2 constraints at confidence 0.95, 1 undetermined; the surest: sure 1.000"
    assert constraints_text(message, 0) == "2 constraints at confidence 0.95, 1 undetermined"


@pytest.mark.parametrize(
    ("changes", "reason", "text"),
    [
        ({"names": ["sure"]}, "wrong_shape", "confidences: 2 numbers, expected 1"),
        ({"confidences": [1.0, 0.5]}, "impossible_constraints", "confidence 0.5 of 'likely', expected 0.95 to 1"),
        ({"confidences": [1.5, 1.0]}, "impossible_constraints", "confidence 1.5 of 'sure', expected 0.95 to 1"),
        ({"confidences": [float("nan"), 1.0]}, "impossible_constraints", "confidence nan of 'sure'"),
        ({"level": float("nan")}, "impossible_constraints", "level nan, expected 0 to 1"),
    ],
)
def test_what_no_learner_says_is_refused(changes: dict[str, Any], reason: str, text: str) -> None:
    message = constraints_message(NAMES, CONFIDENCES, level=0.95)
    for name, value in changes.items():
        setattr(message, name, value)
    with pytest.raises(RefusedMessageError, match=text) as refusal:
        read_constraints(message)
    assert refusal.value.reason == reason
