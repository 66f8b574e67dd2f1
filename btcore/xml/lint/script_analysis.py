"""Find the entries that a script reads and writes, and the statements that always raise."""

import enum
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from btcore.blackboard.blackboard import Blackboard
from btcore.errors import ScriptError
from btcore.script.expressions import (
    Assignment,
    Comparison,
    ConditionalExpression,
    Expression,
    Name,
    OperatorChain,
    UnaryOperation,
)
from btcore.script.parser import Parser

CREATING: Final = ":="


class NameAccess(enum.Enum):
    """How a script uses a name: ``:=`` creates an entry, ``=`` and ``+=`` require that it exists."""

    READ = enum.auto()
    MADE = enum.auto()
    ASSIGNED = enum.auto()


class NameUse(NamedTuple):
    """One use of a name in a script; *column* counts from 1."""

    access: NameAccess
    name: str
    column: int


def parse_statements(text: str, enums: Mapping[str, int]) -> list[Expression]:
    """Parse a script into statements.

    Args:
        text: The script.
        enums: Values of the registered enum names.

    Raises:
        ScriptError: *text* is not a valid script.
    """
    return Parser(text, enums).statements()


def find_name_uses(text: str, enums: Mapping[str, int]) -> list[NameUse]:
    """Return every use of an entry in a script, in the order of evaluation.

    Args:
        text: The script.
        enums: Values of the registered enum names, which are no entries.

    Raises:
        ScriptError: *text* is not a valid script.
    """
    uses: list[NameUse] = []
    for statement in parse_statements(text, enums):
        for part in iter_subexpressions(statement):
            if isinstance(part, Assignment) and isinstance(part.target, Name):
                target = part.target
                access = NameAccess.MADE if part.operator == CREATING else NameAccess.ASSIGNED
                uses.append(NameUse(access, target.name, target.column))
            elif isinstance(part, Name) and part.name not in enums:
                uses.append(NameUse(NameAccess.READ, part.name, part.column))
    return uses


def iter_subexpressions(whole: Expression) -> Iterator[Expression]:
    """Yield *whole* and all expressions in it, except for the names that it assigns to."""
    pending = [whole]
    while pending:
        part = pending.pop()
        yield part
        pending += reversed(_inner(part))


def _inner(part: Expression) -> list[Expression]:
    if isinstance(part, Assignment):
        return [part.value] if isinstance(part.target, Name) else [part.target, part.value]
    if isinstance(part, (OperatorChain, Comparison)):
        return [part.first, *part.operands]
    if isinstance(part, ConditionalExpression):
        return [part.condition, part.then, part.other]
    if isinstance(part, UnaryOperation):
        return [part.operand]
    return []


def is_constant(expression: Expression, enums: Mapping[str, int]) -> bool:
    """Return whether *expression* has the same value for any content of the blackboard."""
    return all(
        not isinstance(part, Assignment) and (not isinstance(part, Name) or part.name in enums)
        for part in iter_subexpressions(expression)
    )


def constant_value(expression: Expression) -> object:
    """Return the value of a constant expression. Raises ScriptError if its evaluation fails."""
    return expression.evaluate(Blackboard())


def find_certain_error(text: str, enums: Mapping[str, int]) -> ScriptError | None:
    """Return the error that every run of a script raises, or None if no error is certain.

    Args:
        text: The script.
        enums: Values of the registered enum names.

    Raises:
        ScriptError: *text* is not a valid script.
    """
    for statement in parse_statements(text, enums):
        for part in iter_subexpressions(statement):
            if isinstance(part, Assignment) and not isinstance(part.target, Name):
                return part.fault(f"the left side of '{part.operator}' is not the name of an entry")
        value = statement.value if isinstance(statement, Assignment) else statement
        if is_constant(value, enums):
            try:
                constant_value(value)
            except ScriptError as error:
                return error
    return None
