"""Convert port texts from format 3 to format 4."""

from typing import Final

from btcore.blackboard.ports import Direction, Port, remapped_key
from btcore.diagnostic_codes import EMPTY_ATTRIBUTE_REMOVED, TEXT_REINTERPRETED, TEXT_REWRITTEN
from btcore.errors import ConversionError
from btcore.values import STRING
from btcore.xml.convert.changes import ConversionContext
from btcore.xml.read.element import Element

_NO_PORTS: Final = ("name", "ID", "_description")


def convert_ports(changes: ConversionContext, element: Element, id: str, new_id: str) -> None:
    """Rewrite the port texts of a node. For unknown nodes only pointers to entries are rewritten.

    Args:
        changes: Collects the changes.
        element: The element of the node.
        id: The ID of the node in format 3.
        new_id: The ID of the node in format 4.
    """
    old = changes.registry.get(id, 3)
    new = changes.registry.get(new_id, 4)
    for name, text in element.attributes.items():
        if name in _NO_PORTS:
            continue
        port = old.ports.get(name) if old is not None else None
        target = new.ports.get(_RENAMED.get((id, name), name)) if new is not None else None
        _convert(changes, element, name, text, port, target)


_RENAMED: Final = {
    ("Parallel", "success_threshold"): "success_count",
    ("Parallel", "failure_threshold"): "failure_count",
}


def _convert(
    changes: ConversionContext, element: Element, name: str, text: str, old: Port | None, new: Port | None
) -> None:
    key = remapped_key(text, name, 3)
    if key is None and old is not None and old.direction is Direction.OUT:
        key = text or None
    if key is not None:
        _pointer(changes, element, name, text, key)
    elif remapped_key(text, name, 4) is not None:
        message = f"'{name}' is the text '{text}' in format 3, and an entry of the blackboard in format 4"
        changes.note(TEXT_REINTERPRETED, message, element, name)
    elif new is not None and new.type.strong and new.type is not STRING:
        _literal(changes, element, name, text, new)


def _pointer(changes: ConversionContext, element: Element, name: str, text: str, key: str) -> None:
    if key == "=" and text != "=":
        message = f"'{name}' is the entry '=' in format 3, and the entry '{name}' in format 4"
        changes.note(TEXT_REINTERPRETED, message, element, name)
        return
    new_text = "{=}" if text == "=" else f"{{{key}}}"
    if text != new_text:
        changes.rewriter.set_attribute(element, name, new_text)
        changes.note(TEXT_REWRITTEN, f'{name}="{text}" becomes {name}="{new_text}"', element, name)


def _literal(changes: ConversionContext, element: Element, name: str, text: str, port: Port) -> None:
    if not text:
        changes.rewriter.remove_attribute(element, name)
        effect = "the default is used" if port.default is not None else "the port is missing in ticks"
        message = f"the empty '{name}' is removed, as it is no {port.type.name} in format 4: {effect}"
        changes.note(EMPTY_ATTRIBUTE_REMOVED, message, element, name)
        return
    if not port.type.converts:
        return
    try:
        value = port.type.from_text(text, 3)
    except ConversionError:
        return
    try:
        same = port.type.from_text(text, 4) == value
    except ConversionError:
        same = False
    if same or not isinstance(value, (int, float)):
        return
    new_text = str(value).lower() if isinstance(value, bool) else repr(value)
    changes.rewriter.set_attribute(element, name, new_text)
    message = f'{name}="{text}" becomes {name}="{new_text}", as format 3 reads it'
    changes.note(TEXT_REWRITTEN, message, element, name)
