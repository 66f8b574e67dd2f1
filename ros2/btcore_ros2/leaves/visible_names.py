"""Hints for a server that is missing: similar names, and the same name with another type."""

from collections.abc import Mapping, Sequence
from typing import Any

from btcore.suggestions import did_you_mean


def hint_for_action(node: Any, name: str, type_name: str) -> str:
    """Return what to do about the missing action server *name* of the type *type_name*."""
    from rclpy.action import get_action_names_and_types

    return _hint(dict(get_action_names_and_types(node)), node.resolve_service_name(name), type_name)


def hint_for_service(node: Any, name: str, type_name: str) -> str:
    """Return what to do about the missing service *name* of the type *type_name*."""
    return _hint(dict(node.get_service_names_and_types()), node.resolve_service_name(name), type_name)


def _hint(visible: Mapping[str, Sequence[str]], name: str, type_name: str) -> str:
    other_types = [visible_type for visible_type in visible.get(name, ()) if visible_type != type_name]
    if other_types:
        return f"'{name}' has the type {', '.join(other_types)}"
    # Names of clients are visible too, so that the name itself is among them.
    return f"start it, or correct the name{did_you_mean(name, set(visible) - {name})}"
