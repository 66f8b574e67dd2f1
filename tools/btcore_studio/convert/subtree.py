"""Convert SubTree and SubTreePlus elements from format 3 to format 4."""

import re
from typing import Final

from btcore.blackboard.ports import braced_key
from btcore.diagnostic_codes import (
    ATTRIBUTE_RENAMED,
    AUTOREMAP_ALL,
    BRACES_ADDED,
    EMPTY_ATTRIBUTE_REMOVED,
    IGNORED_ATTRIBUTE_REMOVED,
    NODE_RENAMED,
    NUMERIC_CONSTANT,
    REMAPPING_CHANGED,
    SHARED_BLACKBOARD,
    SUBTREE_NAME,
    TEXT_REWRITTEN,
)
from btcore.errors import ConversionError
from btcore.names import is_port_name
from btcore.values import BOOL, parse_constant
from btcore.xml.read.element import Element
from btcore_studio.convert.changes import ConversionChanges

_BRACED: Final = re.compile(r" *\$?\{(.+)\} *\Z")


def convert_subtree(changes: ConversionChanges, element: Element, names: set[str]) -> None:
    """Convert a SubTree or SubTreePlus element.

    Args:
        names: Names of the SubTree elements of the same tree that were converted before. This function adds
            the name of *element*.
    """
    attributes = element.attributes
    _convert_name(changes, element, names)
    if element.tag == "SubTreePlus":
        changes.rename_element(element, "SubTree")
        changes.note(NODE_RENAMED, "<SubTreePlus> becomes <SubTree>", element)
        _convert_subtree_plus_attributes(changes, element)
        return
    shared = attributes.get("__shared_blackboard")
    if shared is not None and _is_true(shared):
        _convert_shared_blackboard(changes, element)
        return
    if shared is not None:
        changes.remove_attribute(element, "__shared_blackboard")
        message = "'__shared_blackboard' is removed: by default a tree has its own blackboard"
        changes.note(IGNORED_ATTRIBUTE_REMOVED, message, element, "__shared_blackboard", part="name")
    for name, text in attributes.items():
        if name not in ("ID", "name", "__shared_blackboard"):
            _convert_remapping(changes, element, name, text)


def _convert_name(changes: ConversionChanges, element: Element, names: set[str]) -> None:
    name = element.attributes.get("name")
    if name is None:
        return
    if name in names:
        changes.remove_attribute(element, "name")
        message = (
            f"the name '{name}' is removed: format 3 ignores it, and in format 4 names of calls are unique"
        )
        changes.note(IGNORED_ATTRIBUTE_REMOVED, message, element, "name")
        return
    names.add(name)
    message = f"the name of the node, and of the paths below it, is '{name}'; in format 3 it is the tree's ID"
    changes.note(SUBTREE_NAME, message, element, "name")


def _is_true(text: str) -> bool:
    try:
        return BOOL.from_text(text, 3) is True
    except ConversionError:
        return False


def _convert_shared_blackboard(changes: ConversionChanges, element: Element) -> None:
    """Replace a shared blackboard by `_autoremap`, the closest equivalent in format 4."""
    changes.rename_attribute(element, "__shared_blackboard", "_autoremap")
    changes.set_attribute(element, "__shared_blackboard", "true")
    message = (
        "'__shared_blackboard' becomes '_autoremap': names that begin with '_' are no longer shared with "
        "the outer tree"
    )
    changes.note(SHARED_BLACKBOARD, message, element, "__shared_blackboard", part="name")
    for name in element.attributes:
        if name not in ("ID", "name", "__shared_blackboard"):
            changes.remove_attribute(element, name)
            message = f"'{name}' is removed: it has no effect in format 3 if both trees share a blackboard"
            changes.note(IGNORED_ATTRIBUTE_REMOVED, message, element, name, part="name")


def _convert_remapping(changes: ConversionChanges, element: Element, name: str, text: str) -> None:
    """Convert a remapping `inner="outer"`, which has braces in format 4."""
    braced = _BRACED.match(text)
    if not is_port_name(name):
        _note_lost_connection(changes, element, name)
    elif not text:
        changes.remove_attribute(element, name)
        message = f"the empty '{name}' is removed: in format 4 it would be a constant, the empty text"
        changes.note(EMPTY_ATTRIBUTE_REMOVED, message, element, name)
    elif braced is not None:
        if text != f"{{{braced[1]}}}":
            changes.set_attribute(element, name, f"{{{braced[1]}}}")
        message = (
            f"'{name}' is connected with the entry '{braced[1]}'; in format 3 the braces are part of the "
            "key, so that it is connected with no other entry"
        )
        changes.note(REMAPPING_CHANGED, message, element, name)
    else:
        changes.set_attribute(element, name, f"{{{text}}}")
        changes.note(BRACES_ADDED, f'{name}="{text}" becomes {name}="{{{text}}}"', element, name)


def _note_lost_connection(changes: ConversionChanges, element: Element, name: str) -> None:
    message = f"'{name}' is connected in format 3, but not in format 4: a name begins with a letter there"
    hint = "rename it, here and inside the tree"
    changes.note(REMAPPING_CHANGED, message, element, name, hint, part="name")


def _convert_subtree_plus_attributes(changes: ConversionChanges, element: Element) -> None:
    for name, text in element.attributes.items():
        if name in ("ID", "name"):
            continue
        if name == "__autoremap":
            changes.rename_attribute(element, name, "_autoremap")
            if _is_true(text):
                message = (
                    "'__autoremap' becomes '_autoremap': it connects all names except those that begin with "
                    "'_'; in format 3 it connects all names"
                )
                changes.note(AUTOREMAP_ALL, message, element, name, part="name")
            else:
                message = "'__autoremap' becomes '_autoremap'"
                changes.note(ATTRIBUTE_RENAMED, message, element, name, part="name")
            continue
        # In a SubTreePlus "=" is a constant, while it is a key in the ports of other nodes.
        key = braced_key(text, 3)
        if not is_port_name(name):
            _note_lost_connection(changes, element, name)
        elif key is not None and text != f"{{{key}}}":
            changes.set_attribute(element, name, f"{{{key}}}")
            changes.note(TEXT_REWRITTEN, f'{name}="{text}" becomes {name}="{{{key}}}"', element, name)
        elif key is None and not isinstance(parse_constant(text), str):
            number = parse_constant(text)
            message = f"the constant '{name}' is the number {number!r}; in format 3 it is the text '{text}'"
            changes.note(NUMERIC_CONSTANT, message, element, name)
