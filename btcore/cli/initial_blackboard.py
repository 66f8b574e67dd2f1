"""`btcore run --set`: blackboard entries that are written before the first tick."""

from collections.abc import Iterable, Mapping

import click

from btcore.blackboard.ports import remapped_key
from btcore.cli import terminal
from btcore.errors import BlackboardError, ConversionError
from btcore.json_text import too_deep_at
from btcore.suggestions import nearest_name
from btcore.tree.tree import Tree
from btcore.values import ValueType
from btcore.values.numbers import read_json


def _parse_entries(texts: Iterable[str]) -> dict[str, str]:
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


set_option = click.option(
    "--set",
    "entries",
    multiple=True,
    callback=lambda ctx, option, texts: _parse_entries(texts),
    metavar="KEY=VALUE",
    help="Set an entry of the main tree's blackboard before the first tick. VALUE has the type of the "
    "ports that use KEY; without a typed port it is read as JSON if possible, else as a string. Repeatable.",
)


def _value_of(text: str, kind: ValueType | None, format: int) -> object:
    """Convert the text of a value.

    Args:
        text: The text to convert.
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


def write(tree: Tree, entries: Mapping[str, str]) -> None:
    """Write entries to the blackboard of a tree, before its first tick.

    A key that no port uses is written too; if it resembles a key that a port uses, a warning is printed.

    Args:
        tree: The tree.
        entries: The texts of the values, by key.

    Raises:
        click.UsageError: A text is not a value of its key's type.
    """
    board = tree.blackboard
    for key, text in entries.items():
        entry = board.find(key)
        if entry is None:
            nearest = nearest_name(key, (other for other in board.visible_keys() if other not in entries))
            if nearest is not None:
                terminal.print_warning(
                    f"--set {key}: no port of the tree uses '{key}'; did you mean '{nearest}'?"
                )
        kind = entry.declared if entry is not None and entry.declared.strong else None
        try:
            board.set(key, _value_of(text, kind, tree.format), kind)
        except (BlackboardError, ConversionError) as error:
            raise click.UsageError(f"--set {key}={text}: {error}.") from error
