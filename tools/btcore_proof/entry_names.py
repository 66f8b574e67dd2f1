"""The names of blackboard entries in the scopes of a tree."""

from btcore.blackboard.blackboard import Blackboard
from btcore.blackboard.format3 import Format3Blackboard


def names_of_entry(board: Blackboard, key: str) -> list[str]:
    """Return the names of an entry: *key* in a scope, then its names in the scopes of the calling trees."""
    return [name for _, name in _names(board, key)]


def name_in_main_tree(board: Blackboard, key: str) -> str | None:
    """Return the name of an entry in the main tree, or None if the main tree does not know the entry.

    Args:
        board: The scope.
        key: The key in this scope.
    """
    outermost, name = _names(board, key)[-1]
    return name if outermost.parent is None else None


def _names(board: Blackboard, key: str) -> list[tuple[Blackboard, str]]:
    names = [(board, key)]
    is_format_3 = isinstance(board, Format3Blackboard)
    while (parent := board.parent) is not None:
        if key.startswith("@") and not is_format_3:
            board, key = board.root, key.lstrip("@")
        elif (outside := board.remappings().get(key)) is not None:
            board, key = parent, outside
        elif board.autoremap and (is_format_3 or not key.startswith("_")):
            board = parent
        else:
            break
        names.append((board, key))
    return names
