"""Blackboards as JSON, in the form of BehaviorTree.CPP's ExportTreeToJSON() (src/json_export.cpp).

A tree is `{subtree path: {key: value}}`; the ID of the main tree stands for its empty path. Integers,
bools and members of enums become numbers (a member without a number becomes its name), lists become arrays,
and a dataclass becomes an object with `__type`. Other values, entries that were never written, and
blackboards without entries become null.
"""

import json
from collections.abc import Mapping
from dataclasses import fields, is_dataclass
from enum import Enum
from typing import Any

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import BlackboardError, ConversionError
from btcore.suggestions import did_you_mean, join_names
from btcore.tree.tree import Subtree, Tree
from btcore.values import BOOL, EnumType, TypeRegistry, ValueType

__all__ = ["export_blackboard", "export_tree", "import_blackboard", "import_tree"]

TYPE = "__type"


def export_tree(tree: Tree) -> dict[str, Any]:
    """Return the entries of all blackboards of *tree*, ready for `json.dump`; None for one without entries.

    Examples:
        >>> import btcore
        >>> from btcore.loading.json_export import export_tree, import_tree
        >>> b = btcore.Builder()
        >>> tree = b.build(b.Script(code="battery := 0.8"))
        >>> _ = tree.tick_once()
        >>> saved = export_tree(tree)
        >>> saved
        {'Main': {'battery': 0.8}}
        >>> tree.blackboard["battery"] = 0.1
        >>> import_tree(tree, saved)
        >>> tree.blackboard["battery"]
        0.8
    """
    return {_name(tree, subtree): export_blackboard(subtree.blackboard) or None for subtree in tree.subtrees}


def import_tree(tree: Tree, data: Mapping[str, Mapping[str, Any] | None]) -> None:
    """Write the entries in *data* into the blackboards of *tree*.

    Args:
        tree: The tree.
        data: Entries in the form of `export_tree`.

    Raises:
        BlackboardError: *tree* and *data* have different subtrees; then nothing is written. Or a value does
            not fit the type of its entry; then the entries before it are written.
    """
    boards = {_name(tree, subtree): subtree.blackboard for subtree in tree.subtrees}
    for name in data:
        if name not in boards:
            raise BlackboardError(f"the tree has no subtree '{name}'{did_you_mean(name, boards)}")
    if len(data) != len(boards):
        missing = [name for name in boards if name not in data]
        raise BlackboardError(f"nothing is given for the subtrees {join_names(missing)}")
    for name, entries in data.items():
        import_blackboard(boards[name], entries or {}, tree.registry.types)


def export_blackboard(board: Blackboard) -> dict[str, Any]:
    """Return the values of the entries of *board* itself, by key. Entries of other scopes are left out.

    Examples:
        >>> from btcore import Blackboard
        >>> from btcore.loading.json_export import export_blackboard, import_blackboard
        >>> board = Blackboard()
        >>> board["goal"] = 3
        >>> export_blackboard(board)
        {'goal': 3}
    """
    return {key: _exported(entry.value) for key, entry in board.local_entries().items()}


def import_blackboard(board: Blackboard, data: Mapping[str, Any], types: TypeRegistry) -> None:
    """Write *data* into *board*. None, which is JSON's null, is ignored.

    Args:
        board: The scope.
        data: Values by key.
        types: The registered types, by which objects with `__type` are converted.

    Raises:
        BlackboardError: A value does not fit the type of its entry; the message names the key.
    """
    for key, value in data.items():
        if value is None:
            continue
        try:
            imported = _imported(value, types)
            entry = board.find(key)
            board.set(key, imported if entry is None else _typed(imported, entry.declared))
        except (BlackboardError, ConversionError) as error:
            raise BlackboardError(f"[{key}] can't be imported: {error}") from error


def _name(tree: Tree, subtree: Subtree) -> str:
    return subtree.path or tree.id


def _exported(value: object) -> Any:
    # BehaviorTree.CPP exports bools as numbers. An IntEnum is an int, too, and a StrEnum a str.
    if isinstance(value, int):
        return int(value)
    if isinstance(value, Enum):
        return value.value if isinstance(value.value, int) else value.name
    if value is None or isinstance(value, (str, float)):
        return value
    if isinstance(value, (list, tuple)):
        return [_exported(item) for item in value]
    if is_dataclass(value) and not isinstance(value, type):
        named = {field.name: _exported(getattr(value, field.name)) for field in fields(value)}
        return {TYPE: type(value).__qualname__, **named}
    return None


def _imported(value: Any, types: TypeRegistry) -> object:
    if isinstance(value, list):
        return [_imported(item, types) for item in value]
    if not isinstance(value, dict):
        return value
    name = value.get(TYPE)
    value_type = None if name is None else types.named(str(name))
    if value_type is None:
        problem = f"the object has no '{TYPE}'" if name is None else f"unknown type '{name}'"
        raise ConversionError(f"{problem}; register types with add_type(…)")
    return value_type.from_text("json:" + json.dumps(value))


def _typed(value: object, declared: ValueType) -> object:
    """Return the bool or the enum member that *value* stands for, if the entry has such a type."""
    if (declared is BOOL or isinstance(declared, EnumType)) and isinstance(value, (int, str)):
        return value if declared.accepts(value) else declared.from_text(str(value))
    return value
