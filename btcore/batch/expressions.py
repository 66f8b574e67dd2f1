"""The parts of a script for a batch, one class for each of :mod:`btcore.script.expressions`."""

from typing import Any, Final

import numpy as np

from btcore.batch.assignment import BatchAssignment
from btcore.batch.column import NUMBER, OBJECT, TEXT, TRUTH, to_objects
from btcore.batch.column_table import Slot
from btcore.batch.context import BatchContext, Located
from btcore.batch.script import (
    NO_VALUE,
    BatchExpression,
    BatchProgram,
    Scope,
    ScriptRun,
    ScriptValue,
    apply_each,
    column_value,
    is_number,
    to_doubles,
    value_from_objects,
)
from btcore.errors import ConversionError, ScriptError
from btcore.script.expressions import (
    Assignment,
    Comparison,
    ConditionalExpression,
    Expression,
    Literal,
    Name,
    OperatorChain,
    UnaryOperation,
)
from btcore.script.operators import EPSILON, OPERATORS, compare, negated, operate
from btcore.script.parser import Parser
from btcore.values.numbers import leading_float
from btcore.values.types import as_double, number_of

_AND: Final = OPERATORS["&&"]
_OR: Final = OPERATORS["||"]
_ARITHMETIC: Final[dict[int, Any]] = {
    OPERATORS["+"]: np.add,
    OPERATORS["-"]: np.subtract,
    OPERATORS["*"]: np.multiply,
    OPERATORS["/"]: np.divide,
}
# In the original's sense, which a NaN makes a difference to.
_NOT: Final[dict[str, Any]] = {
    "<": np.greater_equal,
    ">": np.less_equal,
    "<=": np.greater,
    ">=": np.less,
}


class BatchLiteral(BatchExpression):
    """A number or a text."""

    __slots__ = ("value",)

    def __init__(self, value: object) -> None:
        if isinstance(value, str):
            self.value = ScriptValue(value, TEXT, 0)
        elif isinstance(value, int) and abs(value) >= 2**53:
            self.value = ScriptValue(value, OBJECT, 0)
        else:
            self.value = ScriptValue(value, NUMBER, -1 if isinstance(value, int) else 0)

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """The value itself."""
        return self.value


class BatchName(BatchExpression):
    """The name of an entry."""

    __slots__ = ("copies", "name", "slot")

    def __init__(self, name: Name, slot: Slot, copies: bool) -> None:
        self.name = name
        self.copies = copies
        self.slot = slot

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """What the entry holds."""
        column = self.slot.column
        if column is None or column.exists & agents != agents:
            missing = agents if column is None else agents ^ (agents & column.exists)
            run.fail(missing, self.name.fault(f"there is no variable '{self.name.name}' on the blackboard"))
            agents ^= missing
        if column is None or not agents:
            return NO_VALUE
        return column_value(column, agents, self.copies)


class BatchUnaryOperation(BatchExpression):
    """``-``, ``~`` or ``!``, one or more, before a value."""

    __slots__ = ("operand", "prefixed")

    def __init__(self, prefixed: UnaryOperation, operand: BatchExpression) -> None:
        self.prefixed = prefixed
        self.operand = operand

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """A real."""
        value = self.operand.evaluate(run, agents)
        agents = run.drop_failed(agents)
        for sign in reversed(self.prefixed.signs):
            if is_number(value) and sign != "~":
                data = to_doubles(value)
                value = ScriptValue(-data if sign == "-" else data == 0.0, NUMBER, 0)
            else:
                found, agents = apply_each(
                    run, agents, lambda one, sign=sign: negated(sign, one), (value,), self.prefixed.fault
                )
                value = value_from_objects(run, found, agents)
        return value


class BatchBinaryOperations(BatchExpression):
    """A value and what is done to it, from left to right."""

    __slots__ = ("chain", "first", "operands")

    def __init__(self, chain: OperatorChain, first: BatchExpression, operands: list[BatchExpression]) -> None:
        self.chain = chain
        self.first = first
        self.operands = operands

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """The value after the last operator."""
        left = self.first.evaluate(run, agents)
        for index, operand in enumerate(self.operands):
            agents = run.drop_failed(agents)
            if not agents:
                return NO_VALUE
            right = operand.evaluate(run, agents)
            agents = run.drop_failed(agents)
            left = self._operated(run, agents, index, left, right)
        return left

    def _operated(
        self, run: ScriptRun, agents: int, index: int, left: ScriptValue, right: ScriptValue
    ) -> ScriptValue:
        operator = self.chain.operators[index]
        if is_number(left) and is_number(right):
            function = _ARITHMETIC.get(operator)
            if function is not None:
                return ScriptValue(function(to_doubles(left), to_doubles(right)), NUMBER, 0)
            if operator in (_AND, _OR):
                one, other = self._truths(left, agents), self._truths(right, agents)
                if one is not None and other is not None:
                    return ScriptValue(one & other if operator == _AND else one | other, NUMBER, 0)
        token = self.chain.tokens[index]
        found, agents = apply_each(
            run,
            agents,
            lambda one, other: operate(operator, one, other),
            (left, right),
            lambda said: ScriptError(said, self.chain.text, token.start + 1, token.width),
        )
        return value_from_objects(run, found, agents)

    def _truths(self, value: ScriptValue, agents: int) -> Any:
        """The numbers as bools; None where some may be none."""
        data = value.data
        if not isinstance(data, np.ndarray):
            return bool(data) if data in (0, 1) else None
        if data.dtype == np.bool_:
            return data
        bad = data < 0
        if value.integer_agents & agents:
            bad |= data > 1
        return None if bad.any() else data != 0


class BatchComparison(BatchExpression):
    """``a < b <= c``; what follows a false pair is skipped."""

    __slots__ = ("comparison", "first", "operands")

    def __init__(
        self, comparison: Comparison, first: BatchExpression, operands: list[BatchExpression]
    ) -> None:
        self.comparison = comparison
        self.first = first
        self.operands = operands

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """For whom all pairs hold."""
        left = self.first.evaluate(run, agents)
        agents = run.drop_failed(agents)
        found: Any = True
        crowd = run.context.agent_sets
        last = len(self.operands) - 1
        for index, operand in enumerate(self.operands):
            if not agents:
                break
            right = operand.evaluate(run, agents)
            agents = run.drop_failed(agents)
            holds = self._compared(run, agents, index, left, right)
            found = holds if index == 0 else found & holds
            if index < last:
                agents = run.drop_failed(agents)
                if isinstance(holds, np.ndarray):
                    agents &= crowd.from_mask(holds)
                elif not holds:
                    agents = 0
            left = right
        return ScriptValue(found if isinstance(found, np.ndarray) else float(found), NUMBER, 0)

    def _compared(
        self, run: ScriptRun, agents: int, index: int, left: ScriptValue, right: ScriptValue
    ) -> Any:
        token = self.comparison.tokens[index]
        sign = token.kind
        one, other = left.data, right.data
        if is_number(left) and is_number(right):
            if isinstance(one, np.ndarray) or isinstance(other, np.ndarray):
                if sign in _NOT:
                    return ~_NOT[sign](one, other)
                if left.integer_agents & right.integer_agents & agents == agents:
                    same = one == other
                else:
                    same = np.abs(to_doubles(left) - to_doubles(right)) <= EPSILON
                return same if sign == "==" else ~same
            return compare(sign, float(one), float(other), self.comparison.enums)
        if left.form is TEXT and right.form is TEXT and sign in ("==", "!="):
            same = one == other
            if isinstance(same, np.ndarray):
                same = same.astype(np.bool_)
                return same if sign == "==" else ~same
            return same if sign == "==" else not same
        enums = self.comparison.enums
        found, _ = apply_each(
            run,
            agents,
            lambda a, b: compare(sign, a, b, enums),
            (left, right),
            lambda said: ScriptError(said, self.comparison.text, token.start + 1, token.width),
        )
        return found.astype(np.bool_)


class BatchConditional(BatchExpression):
    """``condition ? a : b``; each side is evaluated for those alone who want it."""

    __slots__ = ("choice", "condition", "other", "then")

    def __init__(
        self,
        choice: ConditionalExpression,
        condition: BatchExpression,
        then: BatchExpression,
        other: BatchExpression,
    ) -> None:
        self.choice = choice
        self.condition = condition
        self.then = then
        self.other = other

    def evaluate(self, run: ScriptRun, agents: int) -> ScriptValue:
        """What the sides give."""
        value = self.condition.evaluate(run, agents)
        agents = run.drop_failed(agents)
        crowd = run.context.agent_sets
        if is_number(value):
            data = value.data
            chosen = (
                crowd.from_mask(data != 0) & agents if isinstance(data, np.ndarray) else agents * bool(data)
            )
        else:
            found, agents = apply_each(run, agents, _is_chosen, (value,), self.choice.fault)
            chosen = crowd.from_mask(found.astype(np.bool_)) & agents
        rest = agents ^ chosen
        if not rest:
            return self.then.evaluate(run, chosen) if chosen else NO_VALUE
        if not chosen:
            return self.other.evaluate(run, rest)
        then, other = self.then.evaluate(run, chosen), self.other.evaluate(run, rest)
        mask = crowd.mask(chosen)
        if then.form is NUMBER and other.form is NUMBER:
            return ScriptValue(
                np.where(mask, then.data, other.data),
                NUMBER,
                then.integer_agents & chosen | other.integer_agents & rest,
            )
        if then.form is other.form and then.form is not OBJECT:
            one = np.asarray(then.data, dtype=np.bool_ if then.form is TRUTH else object)
            return ScriptValue(np.where(mask, one, other.data), then.form, 0)
        one = to_objects(then.data, then.form, crowd, chosen, then.integer_agents)
        np.copyto(
            one, to_objects(other.data, other.form, crowd, rest, other.integer_agents), where=crowd.mask(rest)
        )
        return ScriptValue(one, OBJECT, 0)


def _is_chosen(value: object) -> bool:
    if isinstance(value, str):
        return leading_float(value) != 0.0
    number = number_of(value)
    if number is None:
        raise ConversionError(f"the condition before '?' is no number: {value!r}")
    return as_double(number) != 0.0


def compile_expression(expression: Expression, scope: Scope) -> BatchExpression:
    """*expression* for a batch."""
    if isinstance(expression, Literal):
        return BatchLiteral(expression.value)
    if isinstance(expression, Name):
        number = scope.enums.get(expression.name)
        if number is not None:
            return BatchLiteral(float(number))
        return BatchName(expression, scope.slot(expression.name), scope.copies)
    if isinstance(expression, UnaryOperation):
        return BatchUnaryOperation(expression, compile_expression(expression.operand, scope))
    if isinstance(expression, OperatorChain):
        return BatchBinaryOperations(
            expression,
            compile_expression(expression.first, scope),
            [compile_expression(one, scope) for one in expression.operands],
        )
    if isinstance(expression, Comparison):
        return BatchComparison(
            expression,
            compile_expression(expression.first, scope),
            [compile_expression(one, scope) for one in expression.operands],
        )
    if isinstance(expression, ConditionalExpression):
        return BatchConditional(
            expression,
            compile_expression(expression.condition, scope),
            compile_expression(expression.then, scope),
            compile_expression(expression.other, scope),
        )
    assert isinstance(expression, Assignment)
    target = expression.target
    slot = scope.slot(target.name) if isinstance(target, Name) else None
    return BatchAssignment(expression, slot, compile_expression(expression.value, scope), scope.copies)


def compile_batch_script(text: str, scope: Scope, node: Located, context: BatchContext) -> BatchProgram:
    """*text* for a batch. Raises ScriptError for what is no script."""
    statements = []
    for one in Parser(text, scope.enums).statements():
        last = one.value if isinstance(one, Assignment) else one
        statements.append(compile_expression(one, scope._replace(copies=_assigns(last))))
    computes = any(map(_computes, Parser(text, scope.enums).statements()))
    return BatchProgram(text, statements, computes, node, context)


def _computes(expression: Expression) -> bool:
    """Whether there is more in *expression* than a comparison of what is there."""
    if isinstance(expression, Comparison):
        return any(map(_computes, [expression.first, *expression.operands]))
    return not isinstance(expression, (Literal, Name))


def _assigns(expression: Expression) -> bool:
    """Whether there is an assignment in *expression*."""
    if isinstance(expression, Assignment):
        return True
    if isinstance(expression, (OperatorChain, Comparison)):
        return any(map(_assigns, [expression.first, *expression.operands]))
    if isinstance(expression, ConditionalExpression):
        return any(map(_assigns, [expression.condition, expression.then, expression.other]))
    return isinstance(expression, UnaryOperation) and _assigns(expression.operand)
