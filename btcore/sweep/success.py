"""``--success-if``: deciding whether an episode is a success."""

from collections.abc import Sequence
from typing import Final

import click

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import ScriptError
from btcore.script.program import Program, compile_script, condition_result
from btcore.sweep.table import Row

OPTION: Final = "--success-if"
_TREE_STATUSES: Final = ("SUCCESS", "FAILURE", "SKIPPED", "RUNNING")  # not RAISED, REFUSED, BROKEN, KILLED


def parse_script(ctx: click.Context, parameter: click.Parameter, text: str | None) -> Program | None:
    """Parse the script of ``--success-if``, as a callback of click.

    Args:
        ctx: The context of the command.
        parameter: The option.
        text: The script, or None.

    Raises:
        click.UsageError: The script has an error.
    """
    if text is None:
        return None
    try:
        return compile_script(text, {})
    except ScriptError as error:
        raise click.UsageError(f"{OPTION}: {error}") from error


def is_success(row: Row, script: Program | None) -> bool:
    """Return whether an episode is a success.

    An episode that raised an exception, could not start or killed its worker is never a success. An episode
    is no success either if the script needs a column that is empty in this row.

    Args:
        row: The row of the episode.
        script: The condition, whose variables are the columns, with _ instead of a dot. None: the run must
            exit with 0.

    Raises:
        click.UsageError: The script uses a column that does not exist, or fails for another reason.
    """
    if script is None:
        return bool(row["code"] == 0)
    if row["status"] not in _TREE_STATUSES:
        return False
    board = Blackboard()
    for name, value in row.items():
        if value is not None:
            board.set(variable(name), value)
    try:
        return condition_result(script.run(board))
    except ScriptError as error:
        empty = [variable(name) for name, value in row.items() if value is None]
        if any(f"'{name}'" in str(error) for name in empty):
            return False
        raise click.UsageError(f"{OPTION}: {error}\navailable: {', '.join(variables(row))}") from error


def variable(column: str) -> str:
    """Return the variable of a script for *column*."""
    return "".join(letter if letter.isalnum() else "_" for letter in column)


def variables(row: Row) -> Sequence[str]:
    """Return the variables that a script can use."""
    return [variable(name) for name in row if name != "success"]
