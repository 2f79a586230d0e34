"""Parameters of a node: declared with range and description, checked before they count.

Nodes that have them are made with ``automatically_declare_parameters_from_overrides``: what a user gave at the start is
there already, whatever its type, when it is declared.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, ParameterDescriptor, SetParametersResult
from rclpy.node import Node
from rclpy.parameter import Parameter

from dqcontrol.errors import Error, ValueRangeError, unknown_name

_OF_ROS = ("use_sim_time", "start_type_description_service", "qos_overrides.")


class Number(NamedTuple):
    """A number that may be changed while the node runs; None as its value leaves what the spec says."""

    name: str
    value: float | None
    least: float
    most: float
    description: str


def declare(node: Node, numbers: Sequence[Number]) -> None:
    """Declare numbers; those given at the start take the place of their defaults.

    Raises
    ------
    ValueRangeError
        If one given at the start is out of its range, or no number.
    """
    for one in numbers:
        limits = FloatingPointRange(from_value=one.least, to_value=one.most)
        value = _as_number(_given(node, one.name, one.value))
        if value is not None and not _is_within(value, limits):
            raise ValueRangeError(_wrong(one.name, value, limits))
        descriptor = ParameterDescriptor(description=one.description, floating_point_range=[limits])
        descriptor.dynamic_typing = one.value is None
        _declare(node, one.name, value, descriptor)


def declare_switch(node: Node, name: str, description: str) -> None:
    """Declare a parameter that is true or false, false unless it was given at the start.

    Raises
    ------
    ValueRangeError
        If the one given is neither.
    """
    given = _given(node, name, False)
    if type(given) is not bool:
        raise ValueRangeError(f"parameter {name}: expected true or false, got {given!r}")
    _declare(node, name, given, ParameterDescriptor(description=description))


def read_once(node: Node, name: str, value: Any, description: str) -> Any:
    """Declare a parameter that cannot be changed later, and return its value.

    Raises
    ------
    ValueRangeError
        If the one given at the start is of another type than the default.
    """
    if node.has_parameter(name) and node.describe_parameter(name).read_only:
        return node.get_parameter(name).value  # of an earlier attempt to configure the node
    given = _given(node, name, value)
    if not _is_like(given, value):
        kind = "names" if isinstance(value, list) else "a name"
        raise ValueRangeError(f"parameter {name}: expected {kind}, got {given!r}")
    _declare(node, name, given, ParameterDescriptor(description=description, read_only=True))
    return given


def joint_names_read(node: Node, own: list[str]) -> list[str]:
    """Return the names that messages have for joints with names of their own, as the parameter ``joint_names`` says."""
    names = read_once(node, "joint_names", own, "names in messages, in the order of the robot's joints")
    if len(names) != len(own):
        raise ValueRangeError(f"joint_names: expected {len(own)} names, got {len(names)}")
    return list(names)


def refuse_unknown(node: Node) -> None:
    """Check that no parameters were given at the start but those that are declared by now, all with a description.

    Raises
    ------
    UnknownNameError
        If there is one; it names the nearest known one.
    """
    names = [name for name in node.get_parameters_by_prefix("") if not name.startswith(_OF_ROS)]
    allowed = [name for name in names if node.describe_parameter(name).description]
    for name in names:
        if name not in allowed:
            raise unknown_name("parameter", name, allowed)


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
        """Report what ROS will refuse by itself, in our words, and let whole numbers be numbers."""
        checked = []
        for parameter in parameters:
            value = parameter.value
            if not node.has_parameter(parameter.name):
                refuse(f"parameter {parameter.name}: is not declared")
            else:
                for limits in node.describe_parameter(parameter.name).floating_point_range:
                    value = _as_number(value)
                    if not _is_within(value, limits):
                        refuse(_wrong(parameter.name, value, limits))
            checked.append(Parameter(parameter.name, value=value))
        return checked

    def take(parameters: list[Parameter]) -> SetParametersResult:
        for parameter in parameters:
            for limits in node.describe_parameter(parameter.name).floating_point_range:
                if not _is_within(parameter.value, limits):
                    wrong = _wrong(parameter.name, parameter.value, limits)
                    return SetParametersResult(successful=False, reason=wrong)
        try:
            change({one.name: one.value for one in parameters if type(one.value) is float})
        except Error as error:
            refuse(f"parameter: {error}")
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    node.add_pre_set_parameters_callback(check)
    node.add_on_set_parameters_callback(take)


def number(node: Node, name: str) -> float:
    """Return the present value of a number that has one."""
    return float(node.get_parameter(name).value or 0.0)


def numbers_said(node: Node, names: Iterable[str]) -> dict[str, float]:
    """Return the present values of those numbers that have one."""
    values = {name: node.get_parameter(name).value for name in names}
    return {name: float(value) for name, value in values.items() if value is not None}


def _given(node: Node, name: str, default: Any) -> Any:
    """Return what a parameter was set to before it is declared, if it was."""
    return node.get_parameter(name).value if node.has_parameter(name) else default


def _declare(node: Node, name: str, value: Any, descriptor: ParameterDescriptor) -> None:
    if node.has_parameter(name):
        node.undeclare_parameter(name)
    node.declare_parameter(name, value, descriptor, ignore_override=True)


def _as_number(value: Any) -> Any:
    return float(value) if type(value) is int else value


def _is_within(value: object, limits: FloatingPointRange) -> bool:
    return type(value) is float and limits.from_value <= value <= limits.to_value


def _wrong(name: str, value: object, limits: FloatingPointRange) -> str:
    return f"parameter {name}: expected a number {limits.from_value:g} … {limits.to_value:g}, got {value}"


def _is_like(given: Any, default: Any) -> bool:
    if isinstance(default, list):
        return isinstance(given, (list, tuple)) and all(isinstance(one, str) for one in given)
    return isinstance(given, type(default))
