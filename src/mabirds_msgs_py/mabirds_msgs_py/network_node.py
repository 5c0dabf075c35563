"""What all nodes of a network share: timers that no clock stops, and parameters that are never silently ignored."""

from collections.abc import Callable, Sequence
from typing import Any

from rcl_interfaces.msg import ParameterType, SetParametersResult
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.node import Node
from rclpy.parameter import Parameter
from rclpy.timer import Timer

from mabirds_core.errors import MabirdsError

SIM_TIME = "use_sim_time"

NO_SIM_TIME = (
    f"{SIM_TIME} is true, expected false: timers here are steady and iterations decide, so that a clock of /clock would"
    " change nothing but the stamps of messages; leave it out, and set rate or hz to play faster"
)

OF_ROS = ("qos_overrides.", SIM_TIME, "start_type_description_service")
"""How parameters begin that rclpy declares when it wants them."""


class NodeParameterError(MabirdsError):
    """A ROS parameter that a node does not have or cannot honour."""


class NetworkNode(Node):
    """A node whose timers follow a steady clock; ROS's own would stand still where the system's is set back.

    A whole number is taken for a real parameter, ``use_sim_time`` is refused.

    Parameters
    ----------
    name : str
        Of the node.
    **node_options : Any
        Of ``rclpy.node.Node``.

    Raises
    ------
    NodeParameterError
        ``use_sim_time`` is true.
    """

    def __init__(self, name: str, **node_options: Any) -> None:
        self._steady_clock = Clock(clock_type=ClockType.STEADY_TIME)
        super().__init__(name, **node_options)
        if self.get_parameter(SIM_TIME).value:
            super().destroy_node()  # a subclass has nothing to let go of yet
            raise NodeParameterError(NO_SIM_TIME)
        self.add_pre_set_parameters_callback(self._with_real_numbers)
        self.add_on_set_parameters_callback(_refuse_sim_time)

    def create_timer(self, timer_period_sec: float, callback: Callable[[], None], *rest: Any, **options: Any) -> Timer:
        """As of ``rclpy.node.Node``, with a steady clock.

        Parameters
        ----------
        timer_period_sec : float
            Seconds between two calls.
        callback : Callable[[], None]
            What is called.
        *rest : Any
            As of ``rclpy.node.Node``.
        **options : Any
            As of ``rclpy.node.Node``.

        Returns
        -------
        Timer
            Runs already.
        """
        return super().create_timer(timer_period_sec, callback, *rest, **{"clock": self._steady_clock, **options})

    def declare_parameter(self, name: str, value: Any = None, *rest: Any, **options: Any) -> Parameter:
        """As of ``rclpy.node.Node``; where ``value`` is real, one that was given may be whole.

        Parameters
        ----------
        name : str
            Of the parameter.
        value : Any
            Default.
        *rest : Any
            As of ``rclpy.node.Node``.
        **options : Any
            As of ``rclpy.node.Node``.

        Returns
        -------
        Parameter
            As it is now.
        """
        given = self._parameter_overrides.get(name)
        if isinstance(value, float) and given is not None and given.type_ == Parameter.Type.INTEGER:
            self._parameter_overrides[name] = Parameter(name, Parameter.Type.DOUBLE, float(given.value))
        return super().declare_parameter(name, value, *rest, **options)

    def _with_real_numbers(self, parameters: Sequence[Parameter]) -> list[Parameter]:
        return [self._real(parameter) for parameter in parameters]

    def _real(self, parameter: Parameter) -> Parameter:
        whole = parameter.type_ == Parameter.Type.INTEGER and self.has_parameter(parameter.name)
        if not whole:
            return parameter
        described = self.describe_parameter(parameter.name)
        if described.type == ParameterType.PARAMETER_DOUBLE and not described.dynamic_typing:
            return Parameter(parameter.name, Parameter.Type.DOUBLE, float(parameter.value))
        return parameter


def _refuse_sim_time(parameters: Sequence[Parameter]) -> SetParametersResult:
    refused = any(parameter.name == SIM_TIME and parameter.value for parameter in parameters)
    return SetParametersResult(successful=not refused, reason=NO_SIM_TIME if refused else "")


def require_known_parameters(node: Node) -> None:
    """Check that no parameter was given that a node has not declared: ROS would ignore it.

    Raises
    ------
    NodeParameterError
        One was; the message suggests the nearest name.
    """
    declared = [name for name in node._parameters if not name.startswith(OF_ROS)]  # noqa: SLF001 - rclpy has no list
    for name in node._parameter_overrides:  # noqa: SLF001 - rclpy tells nobody what was given
        if name in declared or name.startswith(OF_ROS):
            continue
        import difflib  # for the message alone

        nearest = difflib.get_close_matches(name, declared, n=1)
        hint = f"did you mean {nearest[0]}?" if nearest else f"it has {', '.join(sorted(declared))}"
        raise NodeParameterError(f"{name}: {node.get_name()} has no parameter of this name; {hint}")
