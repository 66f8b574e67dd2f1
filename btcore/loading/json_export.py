"""Blackboards as JSON, in the shape of BehaviorTree.CPP's ExportTreeToJSON (nodes.md §10.7).

A tree is ``{subtree path: {key: value}}``, the main one under its ID. Integers, bools and enums are
numbers, lists arrays; a dataclass is an object with ``__type``. What has no such form, and an entry
that was never written, is null.
"""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import BlackboardError, ConversionError
from btcore.suggestions import join_names, nearest_name
from btcore.tree.tree import Subtree, Tree
from btcore.values import TypeRegistry

TYPE = "__type"


def export_tree(tree: Tree) -> dict[str, dict[str, Any]]:
    """What every blackboard of *tree* holds, ready for ``json.dump``."""
    return {_name(tree, one): export_blackboard(one.blackboard) for one in tree.subtrees}


def import_tree(tree: Tree, data: Mapping[str, Mapping[str, Any]]) -> None:
    """Write *data*, as :func:`export_tree` gave it, into the blackboards of *tree*.

    Raises BlackboardError when the subtrees are others than those of *data*, before anything is
    written, or when an entry's type refuses a value.
    """
    boards = {_name(tree, one): one.blackboard for one in tree.subtrees}
    for name in data:
        if name not in boards:
            guess = nearest_name(name, boards)
            hint = f"; did you mean '{guess}'?" if guess else ""
            raise BlackboardError(f"the tree has no subtree '{name}'{hint}")
    if len(data) != len(boards):
        missing = [name for name in boards if name not in data]
        raise BlackboardError(f"nothing is given for the subtrees {join_names(missing)}")
    for name, entries in data.items():
        import_blackboard(boards[name], entries, tree.registry.types)


def export_blackboard(board: Blackboard) -> dict[str, Any]:
    """What *board* itself holds, by key; remapped entries are their owner's."""
    return {key: _exported(entry.value) for key, entry in board.local_entries().items()}


def import_blackboard(board: Blackboard, data: Mapping[str, Any], types: TypeRegistry) -> None:
    """Write *data* into *board*; null is left out. Raises BlackboardError, which names the key."""
    for key, value in data.items():
        if value is None:
            continue
        try:
            board.set(key, _imported(value, types))
        except (BlackboardError, ConversionError) as fault:
            raise BlackboardError(f"[{key}] can't be imported: {fault}") from fault


def _name(tree: Tree, subtree: Subtree) -> str:
    return subtree.path or tree.id


def _exported(value: object) -> Any:
    if isinstance(value, (bool, int)):
        return int(value)
    if value is None or isinstance(value, (str, float)):
        return value
    if isinstance(value, Enum):
        return value.value if isinstance(value.value, (int, str)) else value.name
    if isinstance(value, (list, tuple)):
        return [_exported(one) for one in value]
    if is_dataclass(value) and not isinstance(value, type):
        named = {one.name: _exported(getattr(value, one.name)) for one in fields(value)}
        return {TYPE: type(value).__qualname__, **named}
    return None


def _imported(value: Any, types: TypeRegistry) -> object:
    if not isinstance(value, dict):
        return value
    name = value.get(TYPE)
    kind = None if name is None else types.named(str(name))
    if kind is None:
        what = f"an object without '{TYPE}'" if name is None else f"a '{name}'"
        raise ConversionError(f"{what} is no type that is registered; add_type(…) makes one known")
    return kind.from_text("json:" + json.dumps(value))
