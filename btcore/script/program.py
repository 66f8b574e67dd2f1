"""Compiled scripts, and the results of conditions."""

from collections.abc import Mapping
from typing import Final

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import ConversionError, ScriptError
from btcore.script.expressions import Expression
from btcore.script.parser import Parser
from btcore.values import as_bool, number_of

_NO_ENUMS: Final[dict[str, int]] = {}


class Program:
    """A compiled script; *text* is its source."""

    def __init__(self, text: str, statements: list[Expression]) -> None:
        self.text = text
        self._statements: list[Expression] = statements

    def run(self, blackboard: Blackboard) -> object:
        """Evaluate all statements on *blackboard*, and return the value of the last statement.

        The value is a number, a text, any other value of an entry, or None for an entry without a value.

        Raises:
            ScriptError: A statement cannot be evaluated. The assignments before it remain.
        """
        value: object = None
        for statement in self._statements:
            value = statement.evaluate(blackboard)
        return value


def compile_script(text: str, enums: Mapping[str, int] | None = None) -> Program:
    """Parse a script.

    Args:
        text: The source of the script.
        enums: The enum names with their numbers. Names may be added later: every run reads the mapping.

    Returns:
        The program, which can be run on any blackboard.

    Raises:
        ScriptError: The script has a syntax error; the exception gives the column.

    Examples:
        >>> import btcore
        >>> board = btcore.Blackboard()
        >>> board["n"] = 3
        >>> btcore.compile_script("n * 2 + 1").run(board)
        7.0
    """
    return Program(text, Parser(text, _NO_ENUMS if enums is None else enums).statements())


def condition_result(value: object) -> bool:
    """Return the result of a condition's script as a bool.

    Zero is false. The integer 1 and every positive float are true.

    Raises:
        ScriptError: The value is a negative float, an integer except 0 and 1, or not a number.
    """
    if isinstance(value, float) and value >= 0.0:
        return value != 0.0
    number = number_of(value)
    if number is None:
        problem = "has no value" if value is None else f"is not a number: {value!r}"
        raise ScriptError(f"the result of a condition {problem}")
    try:
        return as_bool(number)
    except ConversionError as error:
        raise ScriptError(f"the result of a condition is not a bool: {error}") from None
