"""Parameters of a node: declared with range and description, checked before they count."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from dqcontrol.errors import Error


class Number(NamedTuple):
    """A number that may be changed while the node runs."""

    name: str
    value: float
    least: float
    most: float
    description: str


def declare(node: Node, numbers: Sequence[Number]) -> None:
    """Declare numbers, so that ROS itself refuses one out of its range."""
    for one in numbers:
        limits = FloatingPointRange(from_value=one.least, to_value=one.most)
        descriptor = ParameterDescriptor(description=one.description, floating_point_range=[limits])
        node.declare_parameter(one.name, one.value, descriptor)


def on_change(
    node: Node, change: Callable[[dict[str, float]], None], refuse: Callable[[object], None]
) -> None:
    """Hand changed numbers on, and report those refused by their range, their type or ``change``.

    Parameters
    ----------
    node
        Whose.
    change
        Takes the new numbers by name; an `Error` that it raises refuses them all.
    refuse
        Takes the reason.
    """

    def check(parameters: list[Parameter]) -> list[Parameter]:
        for parameter in parameters:
            if not node.has_parameter(parameter.name):
                refuse(f"parameter {parameter.name}: is not declared")
                continue
            for limits in node.describe_parameter(parameter.name).floating_point_range:
                value = parameter.value
                if type(value) is not float or not limits.from_value <= value <= limits.to_value:
                    allowed = f"{limits.from_value:g} … {limits.to_value:g}"
                    refuse(f"parameter {parameter.name}: expected a number {allowed}, got {value}")
        return parameters

    def take(parameters: list[Parameter]) -> SetParametersResult:
        try:
            change({one.name: one.value for one in parameters if type(one.value) is float})
        except Error as error:
            refuse(f"parameter: {error}")
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_pre_set_parameters_callback(check)
    node.add_on_set_parameters_callback(take)


def number(node: Node, name: str) -> float:
    """Return the present value of a number."""
    return float(node.get_parameter(name).value or 0.0)


def read_once(node: Node, name: str, value: Any, description: str) -> Any:
    """Declare a parameter that cannot be changed later, and return its value."""
    descriptor = ParameterDescriptor(description=description, read_only=True)
    return node.declare_parameter(name, value, descriptor).value
