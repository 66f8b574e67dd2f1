"""`btcore run --set`: blackboard entries that are written before the first tick."""

from collections.abc import Iterable, Mapping

import click

from btcore.blackboard.ports import remapped_key
from btcore.cli import terminal
from btcore.errors import BlackboardError, ConversionError, NodeExecutionError
from btcore.json_text import too_deep_at
from btcore.suggestions import did_you_mean
from btcore.tree.tree import Tree
from btcore.values import ValueType
from btcore.values.numbers import read_json
from btcore.xml.plan.plan import Plans


def parse_entries(texts: Iterable[str]) -> dict[str, str]:
    """Return the keys and the texts of their values.

    Args:
        texts: Assignments in the form KEY=VALUE or `{KEY}=VALUE`.

    Raises:
        click.UsageError: A text is not an assignment, or a key is assigned twice.
    """
    entries: dict[str, str] = {}
    for text in texts:
        left_side, equals, value = text.partition("=")
        key = remapped_key(left_side, left_side) or left_side.strip()
        if not equals or not key:
            raise click.UsageError(
                f"--set '{text}' is not an assignment: write KEY=VALUE, for example --set laps=3."
            )
        if key in entries:
            raise click.UsageError(f"--set: '{key}' is set more than once.")
        entries[key] = value
    return entries


def _convert_value(text: str, kind: ValueType | None, format: int) -> object:
    """Convert the text of a value.

    Args:
        kind: The type of the value. None: a JSON value if *text* is valid JSON and not null, else *text*
            itself.
        format: The XML format (3 or 4), whose conversion rules apply.

    Raises:
        ConversionError: *text* is not a value of the type *kind*.
    """
    if kind is not None:
        return kind.from_text(text, format)
    try:
        value = read_json(text)
    except ConversionError:
        if text.lstrip().startswith(("[", "{")) and too_deep_at(text) is not None:
            raise
        return text
    return text if value is None else value


def write(tree: Tree, entries: Mapping[str, str], plans: Plans) -> None:
    """Write entries to the blackboard of a tree, before its first tick.

    A key that no port or script uses is written too, with a warning.

    Args:
        entries: The texts of the values, by key.

    Raises:
        click.UsageError: A text is not a value of its key's type.
    """
    board = tree.blackboard
    without_port = [key for key in entries if board.find(key) is None]
    if without_port:
        _warn_unused(without_port, plans)
    for key, text in entries.items():
        entry = board.find(key)
        kind = entry.declared if entry is not None and entry.declared.strong else None
        try:
            board.set(key, _convert_value(text, kind, tree.format), kind)
        except (BlackboardError, ConversionError) as error:
            raise click.UsageError(f"--set {key}={text}: {error}.") from error


def _warn_unused(keys: Iterable[str], plans: Plans) -> None:
    """Print a warning for each of *keys* that neither a port nor a script of the tree uses."""
    from btcore.xml.lint.dry_run import DryRun  # most runs do not need it

    assert plans.main_tree is not None
    dry_run = DryRun(plans)
    dry_run.run(plans.main_tree)
    board = dry_run.blackboard
    for key in keys:
        hint = did_you_mean(key, board.visible_keys())
        # A leaf that takes the whole blackboard may use any key.
        if board.find(key) is None and (hint or not dry_run.has_untracked_access):
            terminal.print_warning(f"--set {key}: no port or script of the tree uses '{key}'{hint}")


def unwritten_entry_hint(tree: Tree, error: NodeExecutionError) -> str:
    """Return how to set the entry that a node of *tree* needed, but that was never written; "" otherwise."""
    key = getattr(error.cause, "unwritten_key", "")
    board = next((node._blackboard for node in tree.nodes if node.config.path == error.path), None)
    if not key or board is None:
        return ""
    if board is not tree.blackboard:
        # The key in the main tree may be another key.
        entry = board.find(key)
        entries = tree.blackboard.local_entries().items()
        key = next((outer for outer, other in entries if other is entry), "")
    return f"to set the entry before the first tick, use --set {key}=VALUE" if key else ""
