"""``btcore run --set``: what is on the blackboard before the first tick."""

from collections.abc import Iterable, Mapping, Sequence

import click

from btcore.blackboard.ports import remapped_key
from btcore.cli import terminal
from btcore.errors import BlackboardError, ConversionError
from btcore.suggestions import nearest_name
from btcore.tree.tree import Tree
from btcore.values import ValueType
from btcore.values.numbers import read_json


def parse_entries(texts: Iterable[str], option: str = "--set") -> dict[str, str]:
    """Keys and the texts of their values, from KEY=VALUE; ``{KEY}=VALUE`` means the same.

    Raises :class:`click.UsageError`, which names the *option*, for a text of another form.
    """
    found: dict[str, str] = {}
    for text in texts:
        written, equals, value = text.partition("=")
        key = remapped_key(written, written) or written.strip()
        if not equals or not key:
            raise click.UsageError(f"{option} '{text}' sets nothing: write KEY=VALUE, say {option} laps=3.")
        if key in found:
            raise click.UsageError(f"{option}: '{key}' has two values; give one.")
        found[key] = value
    return found


def _callback(ctx: click.Context, parameter: click.Parameter, texts: Sequence[str]) -> dict[str, str]:
    return parse_entries(texts)


set_option = click.option(
    "--set",
    "entries",
    multiple=True,
    callback=_callback,
    metavar="KEY=VALUE",
    help="Write a key of the main tree's blackboard before the first tick. VALUE is read as the ports "
    "that use the key read it; where none has a type, as JSON if it is, else as text. May be given "
    "several times.",
)


def value_of(text: str, kind: ValueType | None, format: int) -> object:
    """What *text* stands for as a *kind*, by the rules of *format*; without one as JSON, else itself.

    Raises ConversionError.
    """
    if kind is not None:
        return kind.from_text(text, format)
    try:
        value = read_json(text)
    except ConversionError:
        return text
    return text if value is None else value


def write(tree: Tree, entries: Mapping[str, str], option: str = "--set") -> None:
    """Write *entries* to the blackboard of *tree*, which wasn't ticked yet.

    Warns of a key that nobody declares if it looks like one that somebody does. Raises
    :class:`click.UsageError` for a text that is no value of its key's type.
    """
    board = tree.blackboard
    for key, text in entries.items():
        entry = board.find(key)
        if entry is None:
            meant = nearest_name(key, (one for one in board.visible_keys() if one not in entries))
            if meant is not None:
                terminal.print_warning(
                    f"{option} {key}: no port of the tree uses '{key}'; did you mean '{meant}'?"
                )
        kind = entry.declared if entry is not None and entry.declared.strong else None
        try:
            board.set(key, value_of(text, kind, tree.format), kind)
        except (BlackboardError, ConversionError) as fault:
            raise click.UsageError(f"{option} {key}={text}: {fault}.") from fault
