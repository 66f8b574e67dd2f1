"""Ports with the content of a message: `json:{…}`, or an entry with a message or a dictionary."""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

from btcore import ConversionError, LiteralProblem, NodeError, Port, TreeNode
from btcore.blackboard.ports import Input
from btcore_ros2.errors import RosError
from btcore_ros2.interfaces import InterfaceError, InterfaceKind, MissingPackageError, load_interface
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

_SPACE: Final = re.compile(r"[ \t\r\n]*")
_DECODER: Final = json.JSONDecoder()


def part_of(interface: Any, part: str) -> Any:
    """Return the class of a part of an interface, such as "Goal"; "" = the interface itself."""
    return getattr(interface, part) if part else interface


class MessagePort:
    """The port of a leaf with the content of a message.

    Args:
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
            self._entries[key] = bound = port.bind(self._node._blackboard)
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


def find_part(text: str, start: int, path: Sequence[str | int], is_name: bool = False) -> tuple[int, int]:
    """Return the position of a part of a value.

    Args:
        text: A text that contains valid JSON from *start* on.
        start: The index at which the JSON begins.
        path: The names of members and the indices of items that lead to the part.
        is_name: Whether to return the position of the name at the end of *path*, and not of the value.

    Returns:
        (index, number of characters). If there is no such part, the position of the last part of *path* that
        exists.

    Examples:
        >>> from btcore_ros2.leaves.message_port import find_part
        >>> text = '{"pose": {"x": 1.5}}'
        >>> at, width = find_part(text, 0, ["pose", "x"])
        >>> text[at : at + width]
        '1.5'
    """
    at = _skip_space(text, start)
    for index, part in enumerate(path):
        name, value = _find_child(text, at, part)
        if value is None:
            break
        if is_name and index == len(path) - 1 and name is not None:
            return name, _end(text, name) - name
        at = value
    return at, _end(text, at) - at


def _find_child(text: str, at: int, part: str | int) -> tuple[int | None, int | None]:
    """Return the indices of the name and the value of a member, or (None, index) of an item."""
    opening = text[at : at + 1]
    if (opening, type(part)) not in (("{", str), ("[", int)):
        return None, None
    place: tuple[int | None, int | None] = (None, None)
    at = _skip_space(text, at + 1)
    number = 0
    while text[at] not in "}]":
        name = None
        key: str | int = number
        if opening == "{":
            name = at
            key, at = _DECODER.raw_decode(text, at)
            at = _skip_space(text, _skip_space(text, at) + 1)  # after the colon
        if key == part:
            place = name, at  # the last of several members with the same name counts
        at = _skip_space(text, _end(text, at))
        if text[at] == ",":
            at = _skip_space(text, at + 1)
        number += 1
    return place


def _end(text: str, at: int) -> int:
    return _DECODER.raw_decode(text, at)[1]


def _skip_space(text: str, at: int) -> int:
    match = _SPACE.match(text, at)
    return at if match is None else match.end()
