"""Read-only ROS parameters of a server."""

from typing import Any

from btcore_ros2.errors import RosError


def declare_parameter(node: Any, name: str, default: Any) -> Any:
    """Declare a read-only parameter, and return its value.

    Args:
        node: The ROS node.
        name: The name of the parameter.
        default: The value if none is given. The parameter must have its type; if it is a float, an integer
            is also allowed. A list is a list of texts.

    Raises:
        RosError: The given value has another type.
    """
    from rcl_interfaces.msg import ParameterDescriptor

    # With dynamic typing an integer for a float is not an error of rclpy.
    descriptor = ParameterDescriptor(read_only=True, dynamic_typing=True)
    value = node.declare_parameter(name, default, descriptor).value
    allowed = (int, float) if isinstance(default, float) else type(default)
    is_valid = isinstance(value, allowed) and not isinstance(value, bool)
    if isinstance(default, list):
        is_valid = isinstance(value, list) and all(isinstance(item, str) for item in value)
    if not is_valid:
        kinds = {str: "a text", int: "an integer", float: "a number", list: "a list of texts"}
        raise RosError(f"the ROS parameter {name} has to be {kinds[type(default)]}, not {value!r}")
    return value
