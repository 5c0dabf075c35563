"""Descriptions of ROS parameters: what each means, its range, and whether it may change while the node runs."""

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor


def text(description: str) -> ParameterDescriptor:
    """A string, fixed at start."""
    return ParameterDescriptor(description=description, read_only=True)


def whole(description: str, lowest: int, highest: int, *, fixed: bool = True) -> ParameterDescriptor:
    """An integer in [lowest, highest]."""
    limits = IntegerRange(from_value=lowest, to_value=highest, step=1)
    return ParameterDescriptor(description=description, integer_range=[limits], read_only=fixed)


def real(description: str, lowest: float, highest: float, *, fixed: bool = True) -> ParameterDescriptor:
    """A floating-point number in [lowest, highest]."""
    limits = FloatingPointRange(from_value=lowest, to_value=highest)
    return ParameterDescriptor(description=description, floating_point_range=[limits], read_only=fixed)
