"""Decorators that make leaves for ROS 2 from functions."""

import inspect
import typing
from collections.abc import Callable
from functools import partial
from typing import Any

from btcore import FAILURE, SUCCESS, NodeError, RegistrationError
from btcore.engine.functions import camel_case
from btcore.engine.signature import PortMark
from btcore_ros2.errors import RosError
from btcore_ros2.leaves.action import ActionErrorCode, RosAction
from btcore_ros2.leaves.service import RosService, ServiceErrorCode
from btcore_ros2.leaves.topics import RosPublisher, RosSubscriber
from btcore_ros2.session import RosSession

Function = Callable[..., Any]


class RosCallError(RosError):
    """Raised in a generator function at its `yield` when its goal or request fails.

    A generator that does not catch it ends with FAILURE.

    Args:
        code: The kind of failure.
        message: What failed.
    """

    def __init__(self, code: ActionErrorCode | ServiceErrorCode, message: str) -> None:
        super().__init__(message)
        self.code = code


def ros_action(
    action_type: Any, action_name: str = "", *, server_timeout: int = 1000, wait_for_server_timeout: int = 500
) -> Callable[[Function], type[RosAction]]:
    """Make a `RosAction` from a function that returns the goal, or a generator function that yields the goal.

    The parameters of the function are ports and resources, as with `btcore.action`. A function returns the
    goal, or None to fail; the leaf succeeds if the goal succeeds. A generator function yields the goal once,
    gets the result message, and returns True, False or a Status. If the goal fails, the `yield` raises
    `RosCallError`. For feedback, write a subclass of `RosAction`.

    Args:
        action_type: The class of the action, or its name, such as `nav2_msgs/action/NavigateToPose`.
        action_name: The default of the port `action_name`.
        server_timeout: The time (ms) that the server has to accept or reject the goal.
        wait_for_server_timeout: The time (ms) in which the server must appear.

    Returns:
        A decorator, which returns a class. Its ID is the name of the function in CamelCase.

    Raises:
        RegistrationError: A parameter of the function has no annotation, or an invalid annotation.

    Examples:
        >>> from btcore import In, Put
        >>> from btcore_ros2.leaves import ros_action
        >>> @ros_action("test_msgs/action/Fibonacci", "fibonacci")
        ... def count(order: In[int], last: Put[int]):
        ...     from test_msgs.action import Fibonacci
        ...     result = yield Fibonacci.Goal(order=order)
        ...     last(result.sequence[-1])
        ...     return True
        >>> count.__name__
        'Count'
    """
    attributes = {
        "action_type": action_type,
        "action_name": action_name,
        "server_timeout": server_timeout,
        "wait_for_server_timeout": wait_for_server_timeout,
    }
    return lambda function: _leaf_class(_FunctionAction, function, attributes)


def ros_service(
    service_type: Any,
    service_name: str = "",
    *,
    server_timeout: int = 1000,
    wait_for_server_timeout: int = 500,
) -> Callable[[Function], type[RosService]]:
    """Make a `RosService` from a function that returns the request, or a generator that yields the request.

    See `ros_action`, with the request in place of the goal, and the response in place of the result.

    Args:
        service_type: The class of the service, or its name, such as `std_srvs/srv/Trigger`.
        service_name: The default of the port `service_name`.
        server_timeout: The time (ms) that the server has to answer.
        wait_for_server_timeout: The time (ms) in which the server must appear.

    Returns:
        A decorator, which returns a class. Its ID is the name of the function in CamelCase.

    Raises:
        RegistrationError: A parameter of the function has no annotation, or an invalid annotation.

    Examples:
        >>> from btcore import In
        >>> from btcore_ros2.leaves import ros_service
        >>> @ros_service("std_srvs/srv/SetBool", "enable_motors")
        ... def enable_motors(on: In[bool] = True):
        ...     from std_srvs.srv import SetBool
        ...     response = yield SetBool.Request(data=on)
        ...     return response.success
        >>> enable_motors.__name__
        'EnableMotors'
    """
    attributes = {
        "service_type": service_type,
        "service_name": service_name,
        "server_timeout": server_timeout,
        "wait_for_server_timeout": wait_for_server_timeout,
    }
    return lambda function: _leaf_class(_FunctionService, function, attributes)


def ros_publisher(
    message_type: Any, topic_name: str = "", *, qos: Any = 1
) -> Callable[[Function], type[RosPublisher]]:
    """Make a `RosPublisher` from a function that returns the message, or None to fail.

    Args:
        message_type: The class of the messages, or its name, such as `std_msgs/msg/String`.
        topic_name: The default of the port `topic_name`.
        qos: A `rclpy.qos.QoSProfile`, or the depth of a reliable profile.

    Returns:
        A decorator, which returns a class. Its ID is the name of the function in CamelCase.

    Raises:
        RegistrationError: A parameter of the function has no annotation, or an invalid annotation.

    Examples:
        >>> from btcore import In
        >>> from btcore_ros2.leaves import ros_publisher
        >>> @ros_publisher("std_msgs/msg/String", "speech")
        ... def say(text: In[str]):
        ...     from std_msgs.msg import String
        ...     return String(data=text)
        >>> say.__name__
        'Say'
    """
    attributes = {"message_type": message_type, "topic_name": topic_name, "qos": qos}
    return lambda function: _leaf_class(_FunctionPublisher, function, attributes)


def ros_subscriber(
    message_type: Any, topic_name: str = "", *, qos: Any = 1, latch: bool = False
) -> Callable[[Function], type[RosSubscriber]]:
    """Make a `RosSubscriber` from a function whose first parameter is the newest message, or None.

    Args:
        message_type: The class of the messages, or its name, such as `std_msgs/msg/String`.
        topic_name: The default of the port `topic_name`.
        qos: A `rclpy.qos.QoSProfile`, or the depth of a reliable profile.
        latch: Whether a message is passed again until a newer message arrives.

    Returns:
        A decorator, which returns a class. Its ID is the name of the function in CamelCase.

    Raises:
        RegistrationError: The function has no parameter for the message, or a parameter after it has no
            annotation or an invalid annotation.

    Examples:
        >>> from btcore import In
        >>> from btcore_ros2.leaves import ros_subscriber
        >>> @ros_subscriber("sensor_msgs/msg/BatteryState", "battery_state", latch=True)
        ... def battery_ok(message, minimum: In[float] = 0.2):
        ...     return message is not None and message.percentage > minimum
        >>> battery_ok.__name__
        'BatteryOk'
    """
    attributes = {"message_type": message_type, "topic_name": topic_name, "qos": qos, "latch": latch}
    return lambda function: _leaf_class(_FunctionSubscriber, function, attributes, takes_message=True)


class _Function:
    """Base of the leaves that are made from functions. Each has a class of its own."""

    _function: Function
    _inputs: list[str]
    _outputs: list[str]
    _resources: dict[str, Any]
    _body: Any = None

    def _call(self, *message: Any) -> Any:
        """Call the function with its ports and resources."""
        values = {name: getattr(self, name) for name in self._inputs}
        set_output: Any = getattr(self, "set_output")  # noqa: B009  the method of the other base class
        values |= {name: partial(set_output, name) for name in self._outputs}
        return type(self)._function(*message, **values, **self._resources)

    def _begin(self) -> Any:
        """Return the goal or the request."""
        self._body = None
        value = self._call()
        if not inspect.isgenerator(value):
            return value
        self._body = value
        # A generator that ends before it yields has no goal.
        return next(value, None)

    def _continue(self, message: Any) -> Any:
        """Pass the result or the response to the generator, and return its status."""
        if self._body is None:
            return SUCCESS
        try:
            self._body.send(message)
        except StopIteration as end:
            return end.value
        raise self._yields_again()

    def _throw(self, error: RosCallError) -> Any:
        """Raise *error* in the generator, and return its status."""
        if self._body is None:
            return FAILURE
        try:
            self._body.throw(error)
        except StopIteration as end:
            return end.value
        except RosCallError:
            return FAILURE
        raise self._yields_again()

    def _yields_again(self) -> NodeError:
        self._body.close()
        return NodeError(f"{type(self)._function.__qualname__} must yield once, but it yields again")

    def _close(self) -> None:
        if self._body is not None:
            self._body.close()
            self._body = None


class _FunctionAction(_Function, RosAction):
    def make_goal(self) -> Any:
        return self._begin()

    def on_result(self, result: Any) -> Any:
        return self._continue(result)

    def on_failure(self, error: ActionErrorCode) -> Any:
        return self._throw(RosCallError(error, self.error_message))

    def on_halted(self) -> None:
        super().on_halted()
        self._close()


class _FunctionService(_Function, RosService):
    def make_request(self) -> Any:
        return self._begin()

    def on_response(self, response: Any) -> Any:
        return self._continue(response)

    def on_failure(self, error: ServiceErrorCode) -> Any:
        return self._throw(RosCallError(error, self.error_message))

    def on_halted(self) -> None:
        super().on_halted()
        self._close()


class _FunctionPublisher(_Function, RosPublisher):
    def make_message(self) -> Any:
        return self._call()


class _FunctionSubscriber(_Function, RosSubscriber):
    def on_message(self, message: Any) -> Any:
        return self._call(message)


def _port_mark(hint: Any) -> PortMark | None:
    """Return what makes a parameter with the annotation *hint* a port; None if it is not a port."""
    return next((mark for mark in typing.get_args(hint) if isinstance(mark, PortMark)), None)


def _leaf_class(
    base: type[Any], function: Function, attributes: dict[str, Any], takes_message: bool = False
) -> Any:
    """Return a subclass of *base* that calls *function*; its ports are those of the function."""
    name = function.__qualname__
    try:
        hints = typing.get_type_hints(function, include_extras=True)
    except NameError as unknown:
        raise RegistrationError(
            f"{name} is annotated with '{unknown.name}', which can't be found: define or import it before "
            "the function (not under TYPE_CHECKING)"
        ) from unknown
    parameters = list(inspect.signature(function).parameters.values())
    if takes_message:
        first = parameters.pop(0) if parameters else None
        if first is None or first.kind is first.KEYWORD_ONLY or _port_mark(hints.get(first.name)):
            problem = f"is '{first.name}'" if first else "is missing"
            raise RegistrationError(
                f"the first parameter of {name} {problem}: write a parameter for the message before it, "
                f"def {function.__name__}(message, …), which is None while there is no message"
            )
    ports: dict[str, Any] = {}
    inputs: list[str] = []
    outputs: list[str] = []
    resources: list[inspect.Parameter] = []
    namespace = dict(attributes)
    for parameter in parameters:
        if parameter.name not in hints:
            raise RegistrationError(
                f"parameter '{parameter.name}' of {name} has no annotation: "
                "annotate a port with In[…] or Put[…], or a resource with its type"
            )
        hint = hints[parameter.name]
        mark = _port_mark(hint)
        if mark is None:
            resources.append(parameter.replace(annotation=hint, kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        ports[parameter.name] = hint
        (outputs if mark.put else inputs).append(parameter.name)
        if parameter.default is not parameter.empty:
            namespace[parameter.name] = parameter.default

    def create(self: Any, session: RosSession, **others: Any) -> None:
        self._resources = others
        base.__init__(self, session)

    own = inspect.signature(create).parameters
    create.__signature__ = inspect.Signature([own["self"], own["session"], *resources])  # type: ignore[attr-defined]
    create.__annotations__ = {"session": RosSession} | {item.name: item.annotation for item in resources}
    namespace |= {
        "__annotations__": ports,
        "__doc__": function.__doc__,
        "__init__": create,
        "__module__": function.__module__,
        "__qualname__": camel_case(function.__name__),
        "_function": staticmethod(function),
        "_inputs": inputs,
        "_outputs": outputs,
    }
    return type(camel_case(function.__name__), (base,), namespace)
