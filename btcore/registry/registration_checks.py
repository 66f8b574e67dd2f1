"""Checks at registration: names, ports, defaults, methods and code that would make every tree fail."""

import ast
import inspect
from collections.abc import Sequence
from textwrap import dedent
from typing import Any, Final

from btcore.blackboard.ports import UNSET, Port, remapped_key
from btcore.engine.coroutine import CoroutineAction, running, sleep
from btcore.engine.leaf import StatefulAction
from btcore.engine.node import TreeNode
from btcore.engine.threaded import ThreadedAction
from btcore.errors import ConversionError, RegistrationError
from btcore.names import RESERVED_IDS, forbidden_in, port_name_error
from btcore.suggestions import join_names
from btcore.values import STRING, UserType, ValueType, VectorType

_METHODS_TO_OVERRIDE: Final[tuple[tuple[type[TreeNode], str], ...]] = (
    (ThreadedAction, "work"),
    (CoroutineAction, "create_body"),
    (StatefulAction, "on_start"),
    (StatefulAction, "on_running"),
)
"""The methods that subclasses of these action classes must override."""
_PAUSES: Final = frozenset(("running", "sleep"))


def check_id(id: str) -> None:
    """Raise RegistrationError if *id* cannot be a tag in the XML."""
    if not id:
        raise RegistrationError("the ID of a node must not be empty")
    if id in RESERVED_IDS:
        raise RegistrationError(f"'{id}' is reserved in Groot, and can't be the ID of a node")
    character = forbidden_in(id)
    if character:
        raise RegistrationError(f"'{id}' can't be the ID of a node: it contains {character!r}")


def check_ports(id: str, ports: Sequence[Port], format: int = 4) -> None:
    """Raise RegistrationError if a port has an invalid name, or a default that does not fit its type."""
    for port in ports:
        error = "" if port.name == "_autoremap" else port_name_error(port.name, format)
        if error:
            message = f"<{id}> can't have a port called '{port.name}': {error}"
            if format == 4 and port.name and not port_name_error(port.name, 3):
                message += "; BehaviorTree.CPP 3 accepts it: nodes.add(…, format=3)"
            raise RegistrationError(message)
        error = default_value_error(port)
        if error:
            default = port.default if port.default_value is UNSET else port.default_value
            takes = f"the port '{port.name}' of <{id}> takes {port.type.name}"
            raise RegistrationError(f"{takes}, but its default is {default!r}: {error}")


def default_value_error(port: Port) -> str:
    """Return why the default of *port* is not a value of its type, or ""."""
    port_type, text, value = port.type, port.default, port.default_value
    # None means "no value". The default of an output is not checked: it is never read as a value.
    if text is None or value is None or not port.reads or not port_type.strong or not _is_known(port_type):
        return ""
    try:
        if value is not UNSET:
            port_type.cast(value)
            return "it is not a text" if port_type is STRING else ""
        if all(remapped_key(text, port.name, format) is None for format in (3, 4)):
            port_type.from_text(text)
    except ConversionError as error:
        return str(error)
    return ""


def _is_known(value_type: ValueType) -> bool:
    """Return whether texts can be converted to a type already: a user's type may get a converter later."""
    if isinstance(value_type, VectorType):
        return _is_known(value_type.item)
    return value_type.converts and not isinstance(value_type, UserType)


def check_class(id: str, cls: type[TreeNode]) -> None:
    """Raise RegistrationError if *cls* is abstract or a frozen dataclass."""
    name = cls.__qualname__
    if inspect.isabstract(cls):
        missing = join_names(f"{method}()" for method in sorted(getattr(cls, "__abstractmethods__", ())))
        raise RegistrationError(f"<{id}>: {name} is abstract: derive a class that implements {missing}")
    dataclass = getattr(cls, "__dataclass_params__", None)
    if dataclass is not None and dataclass.frozen:
        raise RegistrationError(f"<{id}>: {name} is a frozen dataclass, but a node changes when it is ticked")


def check_methods(id: str, cls: type[TreeNode]) -> None:
    """Raise RegistrationError if a StatefulAction lacks a method that a tick would call."""
    if cls.tick is not StatefulAction.tick:
        return
    for base, method in _METHODS_TO_OVERRIDE:
        if issubclass(cls, base) and getattr(cls, method) is getattr(base, method):
            base_name = base.__name__
            raise RegistrationError(
                f"<{id}>: {cls.__qualname__} is a {base_name}, but does not implement {method}(self)"
            )


def check_source(id: str, leaf: Any, outputs: Sequence[str] = ()) -> None:
    """Raise RegistrationError if a leaf does not await a pause, or assigns to an output that it must call.

    Python does not warn about either, although they have no effect. Only the source of the leaf itself is
    checked, if there is one: not the functions that it calls.

    Args:
        leaf: The function or the class.
        outputs: The parameters of the function that write outputs.
    """
    for function in _functions_of(leaf):
        code = getattr(function, "__code__", None)
        if code is None or (not outputs and _PAUSES.isdisjoint(code.co_names)):
            continue
        try:
            source = ast.parse(dedent(inspect.getsource(function)))
        except (OSError, SyntaxError):
            continue  # a function in a console, or a lambda
        for node in ast.walk(source):
            if isinstance(node, ast.Expr) and isinstance(node.value, ast.Call):
                _check_await(id, function, node.value)
        names = [node for node in ast.walk(source) if isinstance(node, ast.Name) and node.id in outputs]
        used = {node.id for node in names if isinstance(node.ctx, ast.Load)}
        if unused := [node.id for node in names if node.id not in used]:
            raise RegistrationError(
                f"<{id}>: {function.__qualname__} assigns to its output '{unused[0]}', which writes "
                f"nothing: call it with the value, {unused[0]}(…)"
            )


def _functions_of(leaf: Any) -> list[Any]:
    """Return a function, or those of a class without the base classes of btcore."""
    members = [leaf]
    if isinstance(leaf, type):
        parents = (parent for parent in leaf.__mro__ if not parent.__module__.startswith("btcore."))
        members = [member for parent in parents for member in vars(parent).values()]
    return [inspect.unwrap(getattr(member, "__func__", member)) for member in members if callable(member)]


def _check_await(id: str, function: Any, call: ast.Call) -> None:
    """Check that *call*, whose result is not used, is no pause: `sleep()`, or `btcore.sleep()`."""
    module, _, name = ast.unparse(call.func).rpartition(".")
    names = function.__globals__
    called = getattr(names.get(module), name, None) if module else names.get(name)
    if called is not running and called is not sleep:
        return
    pause = "running()" if called is running else "sleep(…)"
    if inspect.iscoroutinefunction(function):
        remedy = f"write `await {pause}`"
    elif inspect.isgeneratorfunction(function):
        remedy = f"write `yield {pause}`"
    else:
        remedy = f"make the function an `async def`, and write `await {pause}`"
    code = function.__code__
    raise RegistrationError(
        f"<{id}>: {function.__qualname__} calls {name}() in {code.co_filename}:"
        f"{code.co_firstlineno + call.lineno - 1} without await, which has no effect: {remedy}"
    )
