"""When an episode counts as a success."""

from collections.abc import Sequence
from typing import Final

import click

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import ScriptError
from btcore.script.program import Program, compile_script, condition_result
from btcore.sweep.table import Row

OPTION: Final = "--success-if"
_PLAYED: Final = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")


def parse_script(ctx: click.Context, parameter: click.Parameter, text: str | None) -> Program | None:
    """The script of ``--success-if``; a callback of click. Raises :class:`click.UsageError`."""
    if text is None:
        return None
    try:
        return compile_script(text, {})
    except ScriptError as fault:
        raise click.UsageError(f"{OPTION}: {fault}") from fault


def is_success(row: Row, script: Program | None) -> bool:
    """Whether the episode of *row* is a success: by *script*, else whether its run exits with 0.

    A script finds the row's columns under their names, with _ for a dot. One that raised, was refused or
    killed its worker is never a success, and neither is one for which the script has no answer, as a figure
    has no value. Raises :class:`click.UsageError` for a script that asks for what the row doesn't have.
    """
    if script is None:
        return bool(row["code"] == 0)
    if row["status"] not in _PLAYED:
        return False
    board = Blackboard()
    for name, value in row.items():
        if value is not None:
            board.set(variable(name), value)
    try:
        return condition_result(script.run(board))
    except ScriptError as fault:
        empty = [variable(name) for name, value in row.items() if value is None]
        if any(f"'{name}'" in str(fault) for name in empty):
            return False
        raise click.UsageError(f"{OPTION}: {fault}\nthere are {', '.join(variables(row))}") from fault


def variable(column: str) -> str:
    """What a script calls *column*."""
    return "".join(letter if letter.isalnum() else "_" for letter in column)


def variables(row: Row) -> Sequence[str]:
    """What a script may ask for."""
    return [variable(name) for name in row if name != "success"]
