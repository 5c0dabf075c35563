"""Nodes: steady timers, real parameters that may be whole, none that are ignored, no simulated time."""

from collections.abc import Callable
from typing import Any

import pytest
from rcl_interfaces.srv import SetParameters
from rclpy.clock_type import ClockType
from rclpy.context import Context
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter

from mabirds_msgs_py.network_node import NetworkNode, NodeParameterError, require_known_parameters
from mabirds_msgs_py.ros_parameters import float_param, int_param


class Example(NetworkNode):
    def __init__(self, **options: Any) -> None:
        super().__init__("example", **options)
        self.declare_parameter("rate", 1.0, float_param("speed", 0.5, 100.0, fixed=False))
        self.declare_parameter("count", 3, int_param("how many", 1, 5))


Make = Callable[..., Example]


@pytest.fixture
def make(context: Context) -> Any:
    made: list[Example] = []

    def one(**parameters: Any) -> Example:
        overrides = [Parameter(name, value=value) for name, value in parameters.items()]
        made.append(Example(context=context, parameter_overrides=overrides))
        return made[-1]

    yield one
    for node in made:
        node.destroy_node()


@pytest.mark.parametrize("rate", [10, 10.0])
def test_a_whole_number_is_a_real_one(make: Make, rate: float) -> None:
    value = make(rate=rate).get_parameter("rate")
    assert (value.value, value.type_) == (10.0, Parameter.Type.DOUBLE)


@pytest.mark.parametrize("rate", ["fast", True, [1.0]])
def test_what_is_no_number_is_none(make: Make, rate: object) -> None:
    with pytest.raises(InvalidParameterTypeException):
        make(rate=rate)


def test_the_range_holds_for_whole_numbers_too(make: Make) -> None:
    with pytest.raises(InvalidParameterValueException):
        make(rate=101)
    with pytest.raises(InvalidParameterTypeException):
        make(count=2.0)


def test_while_it_runs_as_well(make: Make) -> None:
    node = make()
    for value, accepted in ((20, True), (0, False), (2.5, True), ("fast", False)):
        assert node.set_parameters([Parameter("rate", value=value)])[0].successful == accepted
    assert node.get_parameter("rate").value == 2.5


def test_through_the_service(make: Make, context: Context) -> None:
    node, executor = make(), SingleThreadedExecutor(context=context)
    executor.add_node(node)
    client = node.create_client(SetParameters, "/example/set_parameters")
    wanted = (("rate", 7), ("use_sim_time", True))
    request = SetParameters.Request(
        parameters=[Parameter(name, value=value).to_parameter_msg() for name, value in wanted]
    )
    for _ in range(100):
        if not client.service_is_ready():
            executor.spin_once(timeout_sec=0.1)
    future = client.call_async(request)
    executor.spin_until_future_complete(future, timeout_sec=10)
    executor.shutdown()
    rate, sim_time = future.result().results
    assert rate.successful
    assert node.get_parameter("rate").value == 7.0
    assert not sim_time.successful
    assert "use_sim_time is true, expected false: timers here are steady" in sim_time.reason


def test_simulated_time_is_refused(make: Make) -> None:
    with pytest.raises(NodeParameterError, match="use_sim_time is true, expected false"):
        make(use_sim_time=True)
    make(use_sim_time=False)


def test_unknown_parameters_are_refused(make: Make) -> None:
    require_known_parameters(make(rate=2.0, use_sim_time=False))
    with pytest.raises(NodeParameterError, match=r"rat: example has no parameter of this name; did you mean rate\?"):
        require_known_parameters(make(rat=2.0))
    with pytest.raises(NodeParameterError, match="it has count, rate"):
        require_known_parameters(make(zzz=2.0))


def test_timers_are_steady_unless_they_are_told_otherwise(make: Make) -> None:
    node = make()
    assert node.create_timer(1.0, lambda: None).clock.clock_type == ClockType.STEADY_TIME
    assert node.create_timer(1.0, lambda: None, clock=node.get_clock()).clock.clock_type == ClockType.ROS_TIME
