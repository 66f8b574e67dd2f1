"""Checks at registration: names, ports, defaults and methods that would make every tree fail."""

import dis
from collections.abc import Sequence
from inspect import isabstract, unwrap
from types import CodeType
from typing import Any, Final

from btcore.blackboard.ports import UNSET, Port, remapped_key
from btcore.engine.coroutine import CoroutineAction
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
    if isabstract(cls):
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


def check_outputs_are_called(id: str, function: Any, outputs: Sequence[str]) -> None:
    """Raise RegistrationError if *function* assigns to a parameter that it must call to write the output.

    A function that has used the parameter before it assigns to the name is accepted.
    """
    code = getattr(unwrap(function), "__code__", None)
    unused = set(outputs)
    if not unused or not isinstance(code, CodeType):
        return
    for instruction in dis.get_instructions(code):
        # Python 3.13 joins two instructions: STORE_FAST_LOAD_FAST has the names of both.
        names = instruction.argval if isinstance(instruction.argval, tuple) else (instruction.argval,)
        if unused.isdisjoint(name for name in names if isinstance(name, str)):
            continue
        if instruction.opname.startswith(("STORE_FAST", "STORE_DEREF")) and names[0] in unused:
            raise RegistrationError(
                f"<{id}>: {function.__qualname__} assigns to its output '{names[0]}', which writes "
                f"nothing: call it with the value, {names[0]}(…)"
            )
        if instruction.opname != "MAKE_CELL":
            unused.difference_update(names)
