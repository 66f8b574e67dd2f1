"""Which entries a script reads and writes, and which of its statements can't but raise."""

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
    """What a script does with a name: ``:=`` makes an entry, ``=`` and ``+=`` need one."""

    READ = enum.auto()
    MADE = enum.auto()
    ASSIGNED = enum.auto()


class NameUse(NamedTuple):
    """One name in a script, in *column* (from 1)."""

    access: NameAccess
    name: str
    column: int


def parse_statements(text: str, enums: Mapping[str, int]) -> list[Expression]:
    """The statements of a script. Raises ScriptError."""
    return Parser(text, enums).statements()


def find_name_uses(text: str, enums: Mapping[str, int]) -> list[NameUse]:
    """Every entry that the script *text* names, in the order in which it gets to them. Raises ScriptError."""
    found: list[NameUse] = []
    for part in (
        one for statement in parse_statements(text, enums) for one in iter_subexpressions(statement)
    ):
        if isinstance(part, Assignment) and isinstance(part.target, Name):
            target = part.target
            how = NameAccess.MADE if part.operator == CREATING else NameAccess.ASSIGNED
            found.append(NameUse(how, target.name, target.column))
        elif isinstance(part, Name) and part.name not in enums:
            found.append(NameUse(NameAccess.READ, part.name, part.column))
    return found


def iter_subexpressions(whole: Expression) -> Iterator[Expression]:
    """*whole* and all that it is made of, but for the names that it assigns to."""
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
    """Whether it has the same value whatever the blackboard holds."""
    return all(
        not isinstance(part, Assignment) and (not isinstance(part, Name) or part.name in enums)
        for part in iter_subexpressions(expression)
    )


def constant_value(expression: Expression) -> object:
    """The value of a constant expression. Raises ScriptError."""
    return expression.evaluate(Blackboard())


def find_certain_error(text: str, enums: Mapping[str, int]) -> ScriptError | None:
    """What any run of the script *text* raises, whatever the blackboard holds; None if nothing is certain.

    Raises ScriptError if it can't be parsed.
    """
    for statement in parse_statements(text, enums):
        for part in iter_subexpressions(statement):
            if isinstance(part, Assignment) and not isinstance(part.target, Name):
                return part.fault(f"only the name of an entry can stand before '{part.operator}'")
        value = statement.value if isinstance(statement, Assignment) else statement
        if is_constant(value, enums):
            try:
                constant_value(value)
            except ScriptError as error:
                return error
    return None
