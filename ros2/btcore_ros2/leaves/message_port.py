"""Ports with the content of a message: `json:{…}`, or an entry with a message or a dictionary."""

from collections.abc import Iterator, Mapping
from typing import Any

from btcore import ConversionError, LiteralProblem, NodeError, Port, TreeNode
from btcore.blackboard.ports import Input
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import InterfaceError, InterfaceKind, MissingPackageError, load_interface
from btcore_ros2.json_positions import find_part
from btcore_ros2.message_values import (
    PREFIX,
    FieldProblem,
    JsonTextError,
    field_type,
    find_problems,
    parse_json,
    path_text,
    referenced_key,
    to_message,
)
from btcore_ros2.session import RosSession

TYPE_PORT = "type"
"""The name of the port with the name of the message, service or action."""


def part_of(interface: Any, part: str) -> Any:
    """Return the class of a part of an interface, such as "Goal"; "" = the interface itself."""
    return getattr(interface, part) if part else interface


class MessagePort:
    """The port of a leaf with the content of a message.

    Args:
        node: The leaf.
        port: The name of the port.
        message_type: The class of the message.
        session: The session of the leaf.
    """

    def __init__(self, node: TreeNode, port: str, message_type: Any, session: RosSession) -> None:
        self._node = node
        self._port = port
        self._type = message_type
        self._session = session
        self._entries: dict[str, Input] = {}
        binding = node.config.input(port)
        self._text = binding.text if binding.key is None else None
        self._is_constant = False
        self._constant: Any = None
        if self._text is not None:
            value = parse_json(self._text) if self._text else {}
            self._is_constant = _is_constant(value)
            if self._is_constant:
                self._constant = to_message(message_type, value, name=port)

    def read(self) -> Any:
        """Return the message for the present values of the entries.

        Raises:
            RosError: The value of an entry does not fit the definition of the message.
            ConversionError: A text is not JSON.
            BlackboardError: An entry was never written.
        """
        if self._is_constant:
            return self._constant
        value = self._node.get_input(self._port)
        return to_message(self._type, value or {}, name=self._port, resolve=self._entry, now=self._now)

    def _entry(self, key: str) -> object:
        bound = self._entries.get(key)
        if bound is None:
            # The same access as by a port, with remappings and error messages.
            port = Input(Port(self._port), f"{{{key}}}", self._node.config.format)
            self._entries[key] = bound = port.bind_or_copy(self._node._blackboard)
        return bound.read()

    def _now(self) -> Any:
        return self._session.node.get_clock().now().to_msg()


def _is_constant(value: object) -> bool:
    """Return whether a value in JSON contains neither an entry nor the present time."""
    if isinstance(value, dict):
        return all(map(_is_constant, value.values()))
    if isinstance(value, list):
        return all(map(_is_constant, value))
    return value != "now" and referenced_key(value) is None


def load_type(node: TreeNode, kind: InterfaceKind) -> Any:
    """Return the class that the port `type` of *node* names, and check the literals of the other ports.

    Raises:
        NodeError: The port is a blackboard entry, or the package is not installed.
        ConversionError: A literal is invalid.
    """
    bindings = [binding for binding in node.config.inputs.values() if binding.key is None]
    literals = {binding.name: binding.text for binding in bindings}
    for problem in type(node).check_literals(literals):
        text = f"port [{problem.port}]: {problem.message}" + (f"; {problem.hint}" if problem.hint else "")
        raise (NodeError if problem.is_unchecked else ConversionError)(text)
    if TYPE_PORT not in literals:
        raise NodeError(
            f"port [{TYPE_PORT}] must be the name of {_ARTICLES[kind]}, and not a blackboard entry"
        )
    return load_interface(literals[TYPE_PORT], kind)


_ARTICLES = {"msg": "a message", "srv": "a service", "action": "an action"}


def message_problems(
    literals: Mapping[str, str],
    kind: InterfaceKind,
    messages: Mapping[str, str],
    fields: Mapping[str, str],
) -> Iterator[LiteralProblem]:
    """Yield the problems of the literals of a leaf; see `TreeNode.check_literals`.

    Args:
        literals: The texts of the ports that are literals, by name.
        kind: The kind of interface that the port `type` names.
        messages: For each port with the content of a message, the part of the interface, such as "Goal".
        fields: For each port with the path of a field, the part of the interface that contains the field.
    """
    interface = None
    if TYPE_PORT in literals:
        try:
            interface = load_interface(literals[TYPE_PORT], kind)
        except MissingPackageError as error:
            yield LiteralProblem(TYPE_PORT, str(error), is_unchecked=True)
        except InterfaceError as error:
            yield LiteralProblem(TYPE_PORT, str(error))
    for port, part in messages.items():
        text = literals.get(port, "")
        if not text:
            continue
        try:
            value = parse_json(text)
        except JsonTextError as error:
            yield LiteralProblem(port, str(error), _quotes_hint(port, text), error.at + 1, 1)
            continue
        if interface is not None:
            for problem in find_problems(part_of(interface, part), value):
                yield _literal_problem(port, text, problem)
    for port, part in fields.items():
        path = literals.get(port, "")
        if path and interface is not None:
            try:
                field_type(part_of(interface, part), path)
            except RosError as error:
                yield LiteralProblem(port, str(error))


def _literal_problem(port: str, text: str, problem: FieldProblem) -> LiteralProblem:
    at, width = find_part(text, len(PREFIX), problem.path, problem.is_name)
    place = path_text((port, *problem.path))
    return LiteralProblem(port, f"{place}: {problem.message}", problem.hint, at + 1, width)


def _quotes_hint(port: str, text: str) -> str:
    return f"""write {port}='json:{{"…": …}}'""" if "'" in text else ""
