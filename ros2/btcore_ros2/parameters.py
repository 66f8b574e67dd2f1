"""ROS parameters of a server: checked, and read-only or changeable."""

from collections.abc import Callable
from typing import Any

from btcore.typed_data import DataError, convert
from btcore_ros2.errors import RosError


def declare_parameter(
    node: Any, name: str, default: Any, *, fixed: str = "", check: Callable[[Any], object] | None = None
) -> Any:
    """Declare a parameter unless the ROS node has it, and return its value.

    Args:
        node: The ROS node.
        name: The name of the parameter.
        default: The value if none is given. The parameter must have its type; if it is a float, an integer
            is also allowed. A list is a list of texts.
        fixed: Why the parameter is read-only, for `ros2 param describe`; "" = a valid value can be set.
        check: Raises a RosError for a value that is invalid, in spite of its type.

    Raises:
        RosError: The given value has another type or is invalid.
    """
    from rcl_interfaces.msg import ParameterDescriptor, SetParametersResult

    def check_value(value: Any) -> None:
        try:
            convert(value, list[str] if isinstance(default, list) else type(default))
        except DataError as error:
            raise RosError(f"the ROS parameter {name} {error.problem}") from None
        if check is not None:
            check(value)

    def allow(changes: list[Any]) -> Any:
        try:
            for change in changes:
                if change.name == name:
                    check_value(change.value)
        except RosError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    is_new = not node.has_parameter(name)
    if is_new:
        # With dynamic typing an integer for a float is not an error of rclpy.
        descriptor = ParameterDescriptor(
            read_only=bool(fixed), dynamic_typing=True, additional_constraints=fixed
        )
        node.declare_parameter(name, default, descriptor)
    value = node.get_parameter(name).value
    check_value(value)
    if is_new and not fixed:
        node.add_on_set_parameters_callback(allow)
    return value
