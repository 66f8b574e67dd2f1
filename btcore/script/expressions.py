"""The syntax tree of a script: expressions that are evaluated on a blackboard.

The typing rules are those of BehaviorTree.CPP 4.10. A value is an int, a float, a text, any other object of
the blackboard, or None for an entry that was never written. The results of arithmetic, comparison and logic
are floats. Integers come only from literals and entries.
"""

from collections.abc import Mapping
from typing import Final

from btcore.blackboard.blackboard import Blackboard, Entry
from btcore.errors import BlackboardError, ConversionError, ScriptError, UndecidedOperandError
from btcore.script.lexer import Token
from btcore.script.operators import (
    OPERATORS,
    assigned_value,
    compare,
    compound_assigned_value,
    description,
    negate,
    number_of_text,
    operate,
)
from btcore.suggestions import did_you_mean
from btcore.values import ANY_VALUE, DOUBLE, INT64, ValueType, as_double, number_of, type_of
from btcore.values.numbers import leading_float
from btcore.values.types import quick_double

_ADD: Final = OPERATORS["+"]
_SUBTRACT: Final = OPERATORS["-"]
_MULTIPLY: Final = OPERATORS["*"]


class Expression:
    """A part of a script.

    Attributes:
        text: The whole script.
        column: The column of the expression or its operator, from 1.
        width: The number of characters to mark in error messages.
    """

    def __init__(self, text: str, token: Token) -> None:
        self.text = text
        self.column = token.start + 1
        self.width = token.width

    def evaluate(self, board: Blackboard) -> object:
        """Evaluate the expression on *board*, and return its value. Raise ScriptError."""
        raise NotImplementedError

    def error(self, message: str, operator: Token | None = None) -> ScriptError:
        """Return an error at the position of this expression, or of one of its operators."""
        if operator is None:
            return ScriptError(message, self.text, self.column, self.width)
        return ScriptError(message, self.text, operator.start + 1, operator.width)

    def no_value_error(self, operand: "Expression", place: str, operator: Token | None = None) -> ScriptError:
        """Return the error for an operand without a value.

        Args:
            place: The place of the operand in the script, such as `before '<'`.
            operator: As in `error`.
        """
        name = operand.name if isinstance(operand, Name) else ""
        entry = f"the entry '{name}'" if name else "the entry"
        error = self.error(f"the operand {place} has no value: {entry} was never written", operator)
        error.unwritten_key = name
        return error


class Literal(Expression):
    """A number or a text."""

    def __init__(self, text: str, token: Token, value: int | float | str) -> None:
        super().__init__(text, token)
        self.value: object = value

    def evaluate(self, board: Blackboard) -> object:
        """Return the value of the literal."""
        return self.value


class Name(Expression):
    """The name of an enum's member or of an entry; the enum has precedence."""

    def __init__(self, text: str, token: Token, enums: Mapping[str, int]) -> None:
        super().__init__(text, token)
        self.name: str = token.text
        self.enums: Mapping[str, int] = enums

    def evaluate(self, board: Blackboard) -> object:
        """Return the enum's number as a float, or the entry's value."""
        number = self.enums.get(self.name)
        if number is not None:
            return float(number)
        entry = board.find(self.name)
        if entry is None:
            hint = did_you_mean(self.name, [*board.visible_keys(), *self.enums])
            error = self.error(f"there is no variable '{self.name}' on the blackboard{hint}")
            error.unwritten_key = self.name
            raise error
        return entry.value


class UnaryOperation(Expression):
    """A value with one or more of the signs `-`, `~` and `!` before it."""

    def __init__(self, text: str, token: Token, signs: list[str], operand: Expression) -> None:
        super().__init__(text, token)
        self.signs: list[str] = signs
        self.operand: Expression = operand

    def evaluate(self, board: Blackboard) -> object:
        """Apply the signs to the operand, and return the result, a float."""
        value = self.operand.evaluate(board)
        try:
            for sign in reversed(self.signs):
                value = negate(sign, value)
        except ConversionError as error:
            if value is None:
                raise self.no_value_error(self.operand, f"after '{self.signs[-1]}'") from None
            raise self.error(str(error)) from None
        return value


class Chain(Expression):
    """A value, and operators with their right operands, evaluated from left to right."""

    def __init__(self, text: str, token: Token, first: Expression) -> None:
        super().__init__(text, token)
        self.first: Expression = first
        self.operands: list[Expression] = []
        self.tokens: list[Token] = []

    def extend(self, token: Token, operand: Expression) -> None:
        """Append an operator and its right operand."""
        self.operands.append(operand)
        self.tokens.append(token)

    def operation_error(self, index: int, left: object, right: object, error: ConversionError) -> ScriptError:
        """Return the error of the operator with number *index*, from 0, at its position."""
        token = self.tokens[index]
        if left is None:
            operand = self.operands[index - 1] if index else self.first
            return self.no_value_error(operand, f"before '{token.text}'", token)
        if right is None:
            return self.no_value_error(self.operands[index], f"after '{token.text}'", token)
        return self.error(str(error), token)


class OperatorChain(Chain):
    """A chain such as `a + b .. c`. All operands are evaluated."""

    def __init__(self, text: str, token: Token, first: Expression) -> None:
        super().__init__(text, token, first)
        self.operators: list[int] = []

    def extend(self, token: Token, operand: Expression) -> None:
        """Append an operator and its right operand."""
        super().extend(token, operand)
        self.operators.append(OPERATORS[token.type])

    def evaluate(self, board: Blackboard) -> object:
        """Return the result of the last operator."""
        left = self.first.evaluate(board)
        for index in range(len(self.operands)):
            right = self.operands[index].evaluate(board)
            operator = self.operators[index]
            # A fast path for the most frequent case, two small numbers. quick_double() returns NaN otherwise.
            if operator <= _MULTIPLY:
                a, b = quick_double(left), quick_double(right)
                if a == a and b == b:
                    if operator == _ADD:
                        left = a + b
                    elif operator == _SUBTRACT:
                        left = a - b
                    else:
                        left = a * b
                    continue
            try:
                left = operate(operator, left, right)
            except ConversionError as error:
                raise self.operation_error(index, left, right, error) from None
        return left


class Comparison(Chain):
    """A chain such as `a < b <= c`: true if it is true for each neighbouring pair.

    The operands after a pair for which it is false are not evaluated.
    """

    def __init__(self, text: str, token: Token, first: Expression, enums: Mapping[str, int]) -> None:
        super().__init__(text, token, first)
        self.enums: Mapping[str, int] = enums

    def evaluate(self, board: Blackboard) -> object:
        """Return 1.0 or 0.0."""
        left = self.first.evaluate(board)
        for index in range(len(self.operands)):
            right = self.operands[index].evaluate(board)
            token = self.tokens[index]
            try:
                holds = compare(token.type, left, right, self.enums)
            except ConversionError as error:
                raise self.operation_error(index, left, right, error) from None
            except UndecidedOperandError as undecided:
                if left is None or right is None:
                    raise self.operation_error(index, left, right, ConversionError()) from None
                holds = undecided.decide(token.type, left, right)
            if not holds:
                return 0.0
            left = right
        return 1.0


class ConditionalExpression(Expression):
    """`condition ? a : b`. The condition is a number or a text that starts with a number.

    It is true unless the number is zero.
    """

    def __init__(
        self, text: str, token: Token, condition: Expression, then: Expression, other: Expression
    ) -> None:
        super().__init__(text, token)
        self.condition: Expression = condition
        self.then: Expression = then
        self.other: Expression = other

    def evaluate(self, board: Blackboard) -> object:
        """Return the value of the selected side; the other side is not evaluated."""
        value = self.condition.evaluate(board)
        try:
            if isinstance(value, str):
                chosen = leading_float(value) != 0.0
            else:
                number = number_of(value)
                if number is None:
                    raise ConversionError(f"the condition before '?' is {description(value)}, not a number")
                chosen = as_double(number) != 0.0
        except ConversionError as error:
            if value is None:
                raise self.no_value_error(self.condition, "before '?'") from None
            raise self.error(str(error)) from None
        return self.then.evaluate(board) if chosen else self.other.evaluate(board)


class Assignment(Expression):
    """An assignment to an entry. `name := value` creates a missing entry.

    The operators `=`, `+=`, `-=`, `*=` and `/=` require that the entry exists.
    """

    def __init__(
        self, text: str, token: Token, target: Expression, value: Expression, enums: Mapping[str, int]
    ) -> None:
        super().__init__(text, token)
        self.operator: str = token.type
        self.target: Expression = target
        self.value: Expression = value
        self.enums: Mapping[str, int] = enums

    def evaluate(self, board: Blackboard) -> object:
        """Assign the value to the entry, and return the stored value."""
        target = self.target
        if not isinstance(target, Name):
            raise self.error(f"only the name of an entry is allowed before '{self.operator}'")
        # Created before the evaluation, as in BehaviorTree.CPP: it exists even if the evaluation raises.
        entry = board.find(target.name)
        if entry is None:
            entry = self._create(board, target)
        value = self.value.evaluate(board)
        if value is None:
            raise self.no_value_error(self.value, f"after '{self.operator}'")
        try:
            if self.operator == ":=" or self.operator == "=":
                if entry.value is None and not isinstance(value, str):
                    value_type = self._type_of(value, board)
                    entry.value_type = None if value_type.same(entry.declared) else value_type
                stored = self.value_to_store(entry, value)
            else:
                stored = compound_assigned_value(self.operator, entry.value, value, entry.declared)
        except ConversionError as error:
            failure = self.error(f"cannot assign to '{target.name}': {error}")
            if entry.value is None:
                failure.unwritten_key = target.name
            raise failure from None
        entry.put(stored, board.now())
        return stored

    def _create(self, board: Blackboard, target: Name) -> Entry:
        if self.operator == ":=":
            try:
                created = board.declare(target.name)
            except BlackboardError as error:
                raise target.error(str(error)) from None
            if board.find(target.name) is None:
                # BehaviorTree.CPP raises, too ("Bug: report"): "@" means the root only where a key is read.
                raise target.error(
                    f"'{target.name}' cannot be created, because a SubTree remaps it to a key that begins "
                    "with '@': remap it to a key without '@', or write to '@…' in the script"
                )
            return created
        hint = did_you_mean(target.name, board.visible_keys()) or ";"
        raise target.error(
            f"there is no entry '{target.name}' on the blackboard, and '{self.operator}' does not create it"
            f"{hint} ':=' creates an entry"
        )

    def value_to_store(self, entry: Entry, value: object) -> object:
        """Return *value*, converted to what `:=` or `=` stores in *entry*. Raise ConversionError."""
        old = entry.value
        declared: ValueType = entry.declared
        if isinstance(value, str) and not isinstance(old, str):
            if declared.strong and declared.converts:
                return declared.from_text(value)
            if declared is ANY_VALUE:
                # BehaviorTree.CPP looks for a converter from text to BT::Any, and there is none.
                raise ConversionError(f"a text cannot replace {description(old)} that SetBlackboard wrote")
            if old is None and not declared.strong:
                return value
            if number_of(old) is not None:
                entry.value_type = DOUBLE  # whatever the type of the number was
                return number_of_text(value, self.enums)
            if old is None:
                raise ConversionError(
                    f"the entry has the type {declared.name}, to which a script converts no text"
                )
            raise ConversionError(f"a text cannot replace {description(old)}")
        if old is None:
            return value
        return assigned_value(value, old, declared)

    def _type_of(self, value: object, board: Blackboard) -> ValueType:
        """Return the type of *value*, which is not a text and becomes the first value of an entry."""
        source = board.find(self.value.name) if isinstance(self.value, Name) else None
        if source is not None and source.value is value:
            return source.type_of_value()
        # BehaviorTree.CPP's scripts have integers of 64 bits.
        return INT64 if isinstance(value, int) else type_of(value)
