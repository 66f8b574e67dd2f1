"""What a script is made of, once parsed: small nodes that are evaluated on a blackboard.

The typing rules are BehaviorTree.CPP 4.10's. A value is an int, a float, a
text, any other object of the blackboard, or None for an entry that was never written. Arithmetic,
comparison and logic give floats; only literals, copies and entries are integers.
"""

import math
from collections.abc import Mapping
from typing import Final

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.errors import BlackboardError, ConversionError, ScriptError
from btcore.script.lexer import Token
from btcore.script.operators import (
    OPERATORS,
    assigned_value,
    compare,
    compound_assigned_value,
    negated,
    operate,
    readable_number,
)
from btcore.suggestions import nearest_name
from btcore.values import ValueType, as_double, number_of
from btcore.values.numbers import leading_float
from btcore.values.types import quick_double

_ADD: Final = OPERATORS["+"]
_SUBTRACT: Final = OPERATORS["-"]
_MULTIPLY: Final = OPERATORS["*"]


class Expression:
    """A part of a script. *text* is the whole script, *column* (from 1) and *width* its place there."""

    text: str
    column: int
    width: int

    def __init__(self, text: str, token: Token) -> None:
        self.text = text
        self.column = token.start + 1
        self.width = token.width

    def evaluate(self, board: Blackboard) -> object:
        """The value on *board*. Raises ScriptError."""
        raise NotImplementedError

    def fault(self, message: str) -> ScriptError:
        """An error at this place."""
        return ScriptError(message, self.text, self.column, self.width)


class Literal(Expression):
    """A number or a text."""

    def __init__(self, text: str, token: Token, value: int | float | str) -> None:
        super().__init__(text, token)
        self.value: object = value

    def evaluate(self, board: Blackboard) -> object:
        """The value itself."""
        return self.value


class Name(Expression):
    """The name of an enum's member, or else of an entry."""

    def __init__(self, text: str, token: Token, enums: Mapping[str, int]) -> None:
        super().__init__(text, token)
        self.name: str = token.text
        self.enums: Mapping[str, int] = enums

    def evaluate(self, board: Blackboard) -> object:
        """The enum's number as a float, or the entry's value."""
        number = self.enums.get(self.name)
        if number is not None:
            return float(number)
        entry = board.find(self.name)
        if entry is None:
            known = [*board.visible_keys(), *self.enums]
            meant = nearest_name(self.name, known)
            hint = f"; did you mean '{meant}'?" if meant else ""
            raise self.fault(f"there is no variable '{self.name}' on the blackboard{hint}")
        return entry.value


class UnaryOperation(Expression):
    """``-``, ``~`` or ``!``, one or more, before a value."""

    def __init__(self, text: str, token: Token, signs: list[str], operand: Expression) -> None:
        super().__init__(text, token)
        self.signs: list[str] = signs
        self.operand: Expression = operand

    def evaluate(self, board: Blackboard) -> object:
        """A float."""
        value = self.operand.evaluate(board)
        try:
            for sign in reversed(self.signs):
                value = negated(sign, value)
        except ConversionError as fault:
            raise self.fault(str(fault)) from None
        return value


class OperatorChain(Expression):
    """A value and what is done to it, from left to right: ``a + b .. c``; nothing is skipped."""

    def __init__(self, text: str, token: Token, first: Expression) -> None:
        super().__init__(text, token)
        self.first: Expression = first
        self.operators: list[int] = []
        self.operands: list[Expression] = []
        self.tokens: list[Token] = []

    def extend(self, token: Token, operand: Expression) -> None:
        """Do one thing more to the value."""
        self.operators.append(OPERATORS[token.kind])
        self.operands.append(operand)
        self.tokens.append(token)

    def evaluate(self, board: Blackboard) -> object:
        """The value after the last operator."""
        left = self.first.evaluate(board)
        for index in range(len(self.operands)):
            right = self.operands[index].evaluate(board)
            operator = self.operators[index]
            if operator <= _MULTIPLY:
                one, other = quick_double(left), quick_double(right)
                if one == one and other == other:
                    if operator == _ADD:
                        left = one + other
                    elif operator == _SUBTRACT:
                        left = one - other
                    else:
                        left = one * other
                    continue
            try:
                left = operate(operator, left, right)
            except ConversionError as fault:
                token = self.tokens[index]
                raise ScriptError(str(fault), self.text, token.start + 1, token.width) from None
        return left


class Comparison(Expression):
    """``a < b <= c``: true (1.0) if each neighbouring pair is; what follows a false one is skipped."""

    def __init__(self, text: str, token: Token, first: Expression, enums: Mapping[str, int]) -> None:
        super().__init__(text, token)
        self.first: Expression = first
        self.operands: list[Expression] = []
        self.tokens: list[Token] = []
        self.enums: Mapping[str, int] = enums

    def extend(self, token: Token, operand: Expression) -> None:
        """Compare with one more."""
        self.operands.append(operand)
        self.tokens.append(token)

    def evaluate(self, board: Blackboard) -> object:
        """1.0 or 0.0."""
        left = self.first.evaluate(board)
        for index in range(len(self.operands)):
            right = self.operands[index].evaluate(board)
            token = self.tokens[index]
            try:
                if not compare(token.kind, left, right, self.enums):
                    return 0.0
            except ConversionError as fault:
                raise ScriptError(str(fault), self.text, token.start + 1, token.width) from None
            left = right
        return 1.0


class ConditionalExpression(Expression):
    """``condition ? a : b``: the condition is a number that is not zero, or a text of one."""

    def __init__(
        self, text: str, token: Token, condition: Expression, then: Expression, other: Expression
    ) -> None:
        super().__init__(text, token)
        self.condition: Expression = condition
        self.then: Expression = then
        self.other: Expression = other

    def evaluate(self, board: Blackboard) -> object:
        """The value of the side chosen; the other side is not evaluated."""
        value = self.condition.evaluate(board)
        try:
            if isinstance(value, str):
                chosen = leading_float(value) != 0.0
            else:
                number = number_of(value)
                if number is None:
                    raise ConversionError(f"the condition before '?' is no number: {_shown(value)}")
                chosen = as_double(number) != 0.0
        except ConversionError as fault:
            raise self.fault(str(fault)) from None
        return self.then.evaluate(board) if chosen else self.other.evaluate(board)


class Assignment(Expression):
    """``name := value``, and ``= += -= *= /=``, which need an entry that exists."""

    def __init__(
        self, text: str, token: Token, target: Expression, value: Expression, enums: Mapping[str, int]
    ) -> None:
        super().__init__(text, token)
        self.operator: str = token.kind
        self.target: Expression = target
        self.value: Expression = value
        self.enums: Mapping[str, int] = enums

    def evaluate(self, board: Blackboard) -> object:
        """The value that was stored."""
        target = self.target
        if not isinstance(target, Name):
            raise self.fault(f"only the name of an entry can stand before '{self.operator}'")
        entry = board.find(target.name)
        if entry is None:
            entry = self._create(board, target)
        value = self.value.evaluate(board)
        if value is None:
            raise self.fault(f"what stands after '{self.operator}' has no value")
        try:
            if self.operator == ":=" or self.operator == "=":
                stored = self._assigned(entry, value)
            else:
                stored = compound_assigned_value(self.operator, entry.value, value, entry.declared)
        except ConversionError as fault:
            raise self.fault(f"'{target.name}' can't take the value: {fault}") from None
        entry.put(stored, board.now())
        return stored

    def _create(self, board: Blackboard, target: Name) -> Entry:
        if self.operator == ":=":
            try:
                return board.create(target.name)
            except BlackboardError as fault:
                raise target.fault(str(fault)) from None
        meant = nearest_name(target.name, board.visible_keys())
        hint = f"did you mean '{meant}'? " if meant else ""
        raise target.fault(
            f"there is no entry '{target.name}' on the blackboard, and '{self.operator}' makes none; "
            f"{hint}':=' makes a new one"
        )

    def _assigned(self, entry: Entry, value: object) -> object:
        """*value* as the entry takes it."""
        old = entry.value
        kind: ValueType = entry.declared
        if isinstance(value, str) and not isinstance(old, str):
            if kind.strong and kind.converts:
                return kind.from_text(value)
            if old is None:
                return value
            if number_of(old) is not None:
                return readable_number(value, self.enums)
            raise ConversionError(f"a text can't become what it holds, {_shown(old)}")
        if old is None:
            return value
        return assigned_value(value, old, kind)


def _shown(value: object) -> str:
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return "it has no value" if value is None else repr(value)
