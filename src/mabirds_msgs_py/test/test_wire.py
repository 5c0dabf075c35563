"""What goes over the wire comes back, with messages as ROS serialises them."""

from pathlib import Path

import numpy as np
from mabirds_msgs.msg import Parameters as ParametersMessage
from rclpy.serialization import deserialize_message, serialize_message

from mabirds_core.algorithm.parameters import Parameters
from mabirds_msgs_py import environment
from mabirds_msgs_py.conversion import parameters_message, read_parameters


def test_parameters_survive_serialisation_to_the_last_bit() -> None:
    sent = Parameters(theta=np.array([1 / 3, -0.0, 5e-324]), omega=np.array([-1e12, np.nextafter(1.0, 2.0)]))
    message = parameters_message("learner_1", 7, sent, "experiment", "schedule", 1_700_000_000_123_456_789)
    received = deserialize_message(serialize_message(message), ParametersMessage)
    back = read_parameters(received, "learner_1", "experiment", "schedule", like=sent)
    assert [values.tobytes() for values in back] == [values.tobytes() for values in sent]
    assert (received.iteration, received.stamp.nanosec) == (7, 123_456_789)


def test_the_profiles_of_fast_dds_come_with_the_package() -> None:
    for profile in (environment.FASTDDS_PROFILE, environment.ONE_HOST_PROFILE, environment.LOOPBACK_PROFILE):
        assert "<profiles" in Path(profile).read_text(encoding="utf-8")
