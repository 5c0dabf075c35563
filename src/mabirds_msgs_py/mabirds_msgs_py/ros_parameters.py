"""Descriptions of ROS parameters: what each means, its range, and whether it may change while the node runs."""

from pathlib import Path

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    ParameterType,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from mabirds_core.errors import ExperimentError
from mabirds_core.experiment.file import Experiment, load_experiment
from mabirds_core.texts import sanitize


def declare_experiment(node: Node) -> None:
    """The parameters that say which experiment a node belongs to."""
    node.declare_parameter("experiment", "", str_param("path of the experiment file (YAML)"))
    node.declare_parameter("run", "", str_param("name of this run; messages of other runs are refused"))


def experiment_of(node: Node) -> tuple[Experiment, str]:
    """The experiment of a node and the digest of its run.

    Raises
    ------
    ExperimentError
        None can be read.
    """
    file = node.get_parameter("experiment").value
    if not file:
        raise ExperimentError("the parameter experiment is not set; give -p experiment:=FILE")
    experiment = load_experiment(Path(file))
    return experiment, experiment.run_digest(node.get_parameter("run").value)


def str_param(description: str) -> ParameterDescriptor:
    """A string, fixed at start."""
    return ParameterDescriptor(description=description, read_only=True)


def bool_param(description: str) -> ParameterDescriptor:
    """True or false, fixed at start."""
    return ParameterDescriptor(description=description, read_only=True)


def strings_param(description: str) -> ParameterDescriptor:
    """Several strings, fixed at start."""
    return ParameterDescriptor(description=description, read_only=True, type=ParameterType.PARAMETER_STRING_ARRAY)


class Numbers:
    """Parameters of a node that are numbers, given as 10 or as 10.0.

    Parameters
    ----------
    node : Node
        Whose parameters.
    """

    def __init__(self, node: Node) -> None:
        self._node, self._ranges = node, dict[str, FloatingPointRange]()
        node.add_on_set_parameters_callback(self._on_set)

    def declare(self, name: str, default: float, descriptor: ParameterDescriptor) -> None:
        """Declare one.

        Parameters
        ----------
        name : str
            Of the parameter.
        default : float
            Where it is not given.
        descriptor : ParameterDescriptor
            Of ``float_param``.
        """
        (self._ranges[name],) = descriptor.floating_point_range
        descriptor.dynamic_typing = True
        self._node.declare_parameter(name, default, descriptor)

    def _on_set(self, parameters: list[Parameter]) -> SetParametersResult:
        for name, value in ((parameter.name, parameter.value) for parameter in parameters):
            limits = self._ranges.get(name)
            if limits and not _is_within(value, limits):
                reason = f"{name} {value!r}: expected a number from {limits.from_value:g} to {limits.to_value:g}"
                return SetParametersResult(successful=False, reason=sanitize(reason))
        return SetParametersResult(successful=True)


def _is_within(value: object, limits: FloatingPointRange) -> bool:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return is_number and limits.from_value <= value <= limits.to_value


def int_param(description: str, lowest: int, highest: int, *, fixed: bool = True) -> ParameterDescriptor:
    """Describe an integer.

    Parameters
    ----------
    description : str
        For people.
    lowest : int
        It may be.
    highest : int
        It may be.
    fixed : bool, optional
        At start; else it may change while the node runs.

    Returns
    -------
    ParameterDescriptor
        With this range.
    """
    limits = IntegerRange(from_value=lowest, to_value=highest, step=1)
    return ParameterDescriptor(description=description, integer_range=[limits], read_only=fixed)


def float_param(description: str, lowest: float, highest: float, *, fixed: bool = True) -> ParameterDescriptor:
    """Describe a floating-point number.

    Parameters
    ----------
    description : str
        For people.
    lowest : float
        It may be.
    highest : float
        It may be.
    fixed : bool, optional
        At start; else it may change while the node runs.

    Returns
    -------
    ParameterDescriptor
        With this range.
    """
    limits = FloatingPointRange(from_value=lowest, to_value=highest)
    return ParameterDescriptor(description=description, floating_point_range=[limits], read_only=fixed)
