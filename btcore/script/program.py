"""A script, parsed once and run as often as needed."""

from collections.abc import Mapping
from typing import Final

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import ConversionError, ScriptError
from btcore.script.expressions import Expression
from btcore.script.parser import Parser
from btcore.values import as_bool, number_of

_NO_ENUMS: Final[dict[str, int]] = {}


class Program:
    """A compiled script. *text* is what it was compiled from."""

    text: str

    def __init__(self, text: str, statements: list[Expression]) -> None:
        self.text = text
        self._statements: list[Expression] = statements

    def run(self, blackboard: Blackboard) -> object:
        """Evaluate every statement on *blackboard*, and return the value of the last.

        A number, a text, whatever an entry holds, or None for an entry without a value. Raises
        ScriptError; what the statements before it wrote stays written.
        """
        value: object = None
        for statement in self._statements:
            value = statement.evaluate(blackboard)
        return value


def compile_script(text: str, enums: Mapping[str, int] | None = None) -> Program:
    """Parse *text*. Raises ScriptError, with a column, for what is no script.

    *enums* maps the names that stand for numbers; it is kept and looked into at every run, so that
    names may still be added.
    """
    return Program(text, Parser(text, _NO_ENUMS if enums is None else enums).statements())


def condition_result(value: object) -> bool:
    """Return the result of a condition's script as a bool.

    A float is true unless it is zero; of the integers only 0 and 1 count; negative numbers, texts
    and entries without a value raise ScriptError.
    """
    if isinstance(value, float) and value >= 0.0:
        return value != 0.0
    number = number_of(value)
    if number is None:
        what = "has no value" if value is None else f"is no number: {value!r}"
        raise ScriptError(f"the result of a condition {what}")
    try:
        return as_bool(number)
    except ConversionError as fault:
        raise ScriptError(f"the result of a condition is no bool: {fault}") from None
