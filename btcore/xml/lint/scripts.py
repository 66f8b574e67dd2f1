"""Which entries a script reads and writes, and which of its statements can't but raise."""

import enum
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

from btcore.blackboard import Blackboard
from btcore.errors import ScriptFault
from btcore.script.expressions import (
    Assignment,
    Chain,
    Choice,
    Comparison,
    Expression,
    Name,
    Prefixed,
)
from btcore.script.parser import Parser

CREATING: Final = ":="


class Mention(enum.Enum):
    """What a script does with a name: ``:=`` makes an entry, ``=`` and ``+=`` need one."""

    READ = enum.auto()
    MADE = enum.auto()
    ASSIGNED = enum.auto()


class Mentioned(NamedTuple):
    """One name in a script, in *column* (from 1)."""

    how: Mention
    name: str
    column: int


def statements(text: str, enums: Mapping[str, int]) -> list[Expression]:
    """The statements of a script. Raises ScriptFault."""
    return Parser(text, enums).statements()


def mentions(text: str, enums: Mapping[str, int]) -> list[Mentioned]:
    """Every entry that the script *text* names, in the order in which it gets to them. Raises ScriptFault."""
    found: list[Mentioned] = []
    for part in (one for statement in statements(text, enums) for one in parts(statement)):
        if isinstance(part, Assignment) and isinstance(part.target, Name):
            target = part.target
            how = Mention.MADE if part.operator == CREATING else Mention.ASSIGNED
            found.append(Mentioned(how, target.name, target.column))
        elif isinstance(part, Name) and part.name not in enums:
            found.append(Mentioned(Mention.READ, part.name, part.column))
    return found


def parts(whole: Expression) -> Iterator[Expression]:
    """*whole* and all that it is made of, but for the names that it assigns to."""
    pending = [whole]
    while pending:
        part = pending.pop()
        yield part
        pending += reversed(_inner(part))


def _inner(part: Expression) -> list[Expression]:
    if isinstance(part, Assignment):
        return [part.value] if isinstance(part.target, Name) else [part.target, part.value]
    if isinstance(part, (Chain, Comparison)):
        return [part.first, *part.operands]
    if isinstance(part, Choice):
        return [part.condition, part.then, part.other]
    if isinstance(part, Prefixed):
        return [part.operand]
    return []


def is_constant(expression: Expression, enums: Mapping[str, int]) -> bool:
    """Whether it has the same value whatever the blackboard holds."""
    return all(
        not isinstance(part, Assignment) and (not isinstance(part, Name) or part.name in enums)
        for part in parts(expression)
    )


def constant_value(expression: Expression) -> object:
    """The value of a constant expression. Raises ScriptFault."""
    return expression.evaluate(Blackboard())


def sure_to_raise(text: str, enums: Mapping[str, int]) -> ScriptFault | None:
    """What any run of the script *text* raises, whatever the blackboard holds; None if nothing is certain.

    Raises ScriptFault if it can't be parsed.
    """
    for statement in statements(text, enums):
        for part in parts(statement):
            if isinstance(part, Assignment) and not isinstance(part.target, Name):
                return part.fault(f"only the name of an entry can stand before '{part.operator}'")
        value = statement.value if isinstance(statement, Assignment) else statement
        if is_constant(value, enums):
            try:
                constant_value(value)
            except ScriptFault as fault:
                return fault
    return None
