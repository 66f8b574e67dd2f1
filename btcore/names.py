"""The rules for names of nodes, trees and ports, both in registrations and in XML; reserved names."""

from collections import Counter
from collections.abc import Sequence
from typing import Final

PLUGIN_FILE_PREFIX: Final = "btcore_plugin_"
"""The names of modules that are loaded from a plugin's file begin with this prefix."""

# Spaces, characters with a meaning in XML, paths or patterns, and control characters, as in BehaviorTree.CPP.
FORBIDDEN: Final = frozenset(" \t\r\n<>&\"'/\\:*?|.") | {chr(code) for code in (*range(32), 127)}
"""The characters that are not allowed in an ID."""
PRECONDITION_ATTRIBUTES: Final = ("_failureIf", "_successIf", "_skipIf", "_while")
POSTCONDITION_ATTRIBUTES: Final = ("_onHalted", "_onFailure", "_onSuccess", "_post")
SCRIPT_ATTRIBUTES: Final = (*PRECONDITION_ATTRIBUTES, *POSTCONDITION_ATTRIBUTES)
"""The attributes with scripts, in the order of their execution."""
# Without "_autoremap": the models that BehaviorTree.CPP writes list it as a port of SubTree.
_RESERVED_ATTRIBUTES: Final = frozenset({*SCRIPT_ATTRIBUTES, "ID", "name"})
RESERVED_IDS: Final = frozenset({"Root", "root"})
"""The names that no node or tree may have."""


def forbidden_in(name: str) -> str:
    """Return the first character of *name* that is not allowed in an ID, or "". All letters are allowed."""
    return next((char for char in name if char in FORBIDDEN), "")


def port_name_error(name: str, format: int = 4) -> str:
    """Return why *name* is not a valid port name, or "" if it is valid.

    Args:
        format: The XML format. Format 3 allows every name that has no other meaning in the XML.
    """
    if not name:
        return "the name is empty"
    if name in ("name", "ID"):
        return "in the XML, this attribute identifies the node"
    if format == 3:
        return "in the XML, this attribute describes the node" if name == "_description" else ""
    character = forbidden_in(name)
    if character:
        return f"it contains {character!r}"
    # Non-ASCII characters are allowed, but not at the start.
    return "" if name[0].isascii() and name[0].isalpha() else "the name of a port must begin with a letter"


def model_port_name_error(name: str) -> str:
    """Return why *name* is not a valid port name in a subtree model of format 4, or "" if it is valid."""
    if not name:
        return "the name is empty"
    if name in _RESERVED_ATTRIBUTES:
        return "this attribute is reserved"
    character = forbidden_in(name)
    if character:
        return f"it contains {character!r}"
    return "it begins with a digit" if name[0].isascii() and name[0].isdigit() else ""


def is_port_name(name: str) -> bool:
    """Return whether *name* is a valid port name in format 4."""
    return not port_name_error(name)


def names_in(text: str) -> list[str]:
    """Return the names in a text, which commas separate."""
    return [name for part in text.split(",") if (name := part.strip())]


def unique_paths(paths: Sequence[str]) -> list[str]:
    """Return the paths of nodes, in pre-order. `#1`, `#2` … are appended to equal paths."""
    times = Counter(paths)
    numbers: Counter[str] = Counter()
    unique: dict[str, None] = {}
    for path in paths:
        key = path
        while key in unique or (key == path and times[path] > 1):
            numbers[path] += 1
            key = f"{path}#{numbers[path]}"
        unique[key] = None
    return list(unique)
