"""Which names nodes, trees and ports may have: one rule for what is registered and what is written in XML."""

from typing import Final

# Spaces, what XML, paths and patterns mean something by, and control characters (nodes.md §9.1, §10.2).
_FORBIDDEN: Final = frozenset(" \t\r\n<>&\"'/\\:*?|.") | {chr(code) for code in (*range(32), 127)}
_RESERVED_IN_3: Final = frozenset({"ID", "name", "_description"})
# Without "_autoremap", which the models that C++ writes have for the SubTree itself.
_RESERVED_ATTRIBUTES: Final = frozenset(
    {"ID", "name", "_failureIf", "_successIf", "_skipIf", "_while"}
    | {"_onHalted", "_onFailure", "_onSuccess", "_post"}
)
_RESERVED_IDS: Final = frozenset({"Root", "root"})


def forbidden_in(name: str) -> str:
    """The first character of *name* that no ID may hold, or "" (UTF-8 letters are allowed)."""
    return next((char for char in name if char in _FORBIDDEN), "")


def is_reserved(ID: str) -> bool:
    """Whether neither a node nor a tree may be called *ID*."""
    return ID in _RESERVED_IDS


def port_name_error(name: str, format: int = 4) -> str:
    """Why no port of a node may be called *name*, or "" if one may.

    Format 3 takes any name that doesn't say something else in the XML.
    """
    if not name:
        return "it has no name"
    if name in ("name", "ID"):
        return "in the XML that attribute says which node it is"
    if format == 3:
        return "that attribute is a description" if name in _RESERVED_IN_3 else ""
    bad = forbidden_in(name)
    if bad:
        return f"it holds {bad!r}"
    # Bytes over 127 are allowed, but a name begins with a letter.
    if not (name[0].isascii() and name[0].isalpha()):
        return "the name of a port begins with a letter"
    return ""


def model_port_name_error(name: str) -> str:
    """Why format 4 takes no port *name* in the model of a subtree, or "" if it does."""
    if not name:
        return "it has no name"
    if name in _RESERVED_ATTRIBUTES:
        return "that attribute has a meaning of its own"
    bad = forbidden_in(name)
    if bad:
        return f"it holds {bad!r}"
    return "it begins with a digit" if name[0].isascii() and name[0].isdigit() else ""


def is_port_name(name: str) -> bool:
    """Whether format 4 takes the attribute *name* as a port (nodes.md §9.1)."""
    return not port_name_error(name)
